//! Removes from a function what is never run, and what computes constants.

use super::Constants;
use super::propagate::{Found, ids, label};
use rspirv::dr::{Block, Function, Instruction, Module, Operand};
use rspirv::spirv::{Op, Word};
use std::collections::{HashMap, HashSet};

/// Rewrites function number `function` of `module` by what was found out about it.
///
/// A conditional branch that goes but one way becomes an unconditional one, and the selection that it headed is none
/// any more. Two kinds of blocks stay though nothing leads to them, since loops and selections have to name them: a
/// loop's continue target then only leads back to its header, a merge block only says that it is unreachable. The
/// branch at the end of a loop that leads back to its header stays as it is, with a constant condition.
pub(super) fn prune(module: &mut Module, function: usize, found: &Found, constants: &mut Constants) {
    let types: HashMap<Word, Word> = module.functions[function]
        .blocks
        .iter()
        .flat_map(|block| &block.instructions)
        .filter_map(|instruction| Some((instruction.result_id?, instruction.result_type?)))
        .collect();
    let mut replaced = HashMap::new();
    for (&id, &value) in &found.constants {
        if let Some(&kind) = types.get(&id) {
            replaced.insert(id, constants.id(kind, value));
        }
    }
    let mut undefined = Undefined { ids: HashMap::new(), new: Vec::new() };
    let function = &mut module.functions[function];
    let flow = Flow::new(function, found);
    let blocks = std::mem::take(&mut function.blocks);
    for mut block in blocks {
        let Some(own) = label(&block) else { continue };
        if let Some(last) = flow.stubs.get(&own) {
            block.instructions = vec![last.clone()];
        } else if found.reachable.contains(&own) {
            flow.shorten(&mut block, own);
            for phi in block.instructions.iter_mut().filter(|i| i.class.opcode == Op::Phi) {
                flow.rewrite_phi(phi, own, &mut undefined, constants);
            }
            block.instructions.retain(|i| i.result_id.is_none_or(|id| !replaced.contains_key(&id)));
        } else {
            continue;
        }
        function.blocks.push(block);
    }
    for operand in
        function.blocks.iter_mut().flat_map(|block| &mut block.instructions).flat_map(|i| &mut i.operands)
    {
        if let Operand::IdRef(id) = operand
            && let Some(&constant) = replaced.get(id)
        {
            *id = constant;
        }
    }
    remove_unused(function);
    for (kind, id) in undefined.new {
        module.types_global_values.push(Instruction::new(Op::Undef, Some(kind), Some(id), vec![]));
    }
}

/// How control flows through what is left of a function.
struct Flow {
    /// The targets of conditional branches of which but one way is ever taken, by the labels of their blocks.
    folded: HashMap<Word, Word>,
    /// The branches that are left, from label to label.
    edges: HashSet<(Word, Word)>,
    /// Blocks that stay though they are never run: the only instruction of each.
    stubs: HashMap<Word, Instruction>,
    /// The continue targets among them, by the header of their loop.
    back_to: HashMap<Word, Word>,
}

impl Flow {
    fn new(function: &Function, found: &Found) -> Flow {
        let mut flow = Flow {
            folded: HashMap::new(),
            edges: HashSet::new(),
            stubs: HashMap::new(),
            back_to: HashMap::new(),
        };
        // Labels of this block and those before it: a branch to one of them leads back to a loop's header.
        let mut before = HashSet::new();
        for block in &function.blocks {
            let Some(own) = label(block) else { continue };
            before.insert(own);
            let (Some(last), true) = (block.instructions.last(), found.reachable.contains(&own)) else {
                continue;
            };
            let mut targets = targets(last);
            if last.class.opcode == Op::BranchConditional && !targets.iter().any(|to| before.contains(to)) {
                targets.retain(|&target| found.edges.contains(&(own, target)));
                if let [target] = targets[..] {
                    flow.folded.insert(own, target);
                }
            }
            flow.edges.extend(targets.into_iter().map(|target| (own, target)));
            let Some(merge) = merge_of(block) else { continue };
            let named: Vec<Word> = ids(merge).collect();
            let stays = merge.class.opcode == Op::LoopMerge || !flow.folded.contains_key(&own);
            if stays && !found.reachable.contains(&named[0]) {
                let unreachable = Instruction::new(Op::Unreachable, None, None, vec![]);
                // It may be the continue target of a loop around, which leads back.
                flow.stubs.entry(named[0]).or_insert(unreachable);
            }
            if let Some(&target) = named.get(1).filter(|target| !found.reachable.contains(target)) {
                let back = Instruction::new(Op::Branch, None, None, vec![Operand::IdRef(own)]);
                flow.stubs.insert(target, back);
                flow.back_to.insert(own, target);
            }
        }
        flow
    }

    /// Makes an unconditional branch of a conditional one that goes but one way.
    fn shorten(&self, block: &mut Block, own: Word) {
        let Some(&target) = self.folded.get(&own) else { return };
        let heads_selection = merge_of(block).is_some_and(|merge| merge.class.opcode == Op::SelectionMerge);
        block.instructions.truncate(block.instructions.len() - if heads_selection { 2 } else { 1 });
        block.instructions.push(Instruction::new(Op::Branch, None, None, vec![Operand::IdRef(target)]));
    }

    /// Leaves in a phi what comes from blocks that still lead here.
    fn rewrite_phi(
        &self,
        phi: &mut Instruction,
        own: Word,
        undefined: &mut Undefined,
        constants: &mut Constants,
    ) {
        let pairs: Vec<Word> = ids(phi).collect();
        let left = pairs.chunks(2).filter(|pair| self.edges.contains(&(pair[1], own)));
        let mut operands: Vec<Word> = left.flatten().copied().collect();
        if let (Some(&stub), Some(kind)) = (self.back_to.get(&own), phi.result_type) {
            operands.extend([undefined.id(kind, constants), stub]);
        }
        phi.operands = operands.into_iter().map(Operand::IdRef).collect();
    }
}

/// Where a block can go on after its last instruction.
fn targets(last: &Instruction) -> Vec<Word> {
    let decided_by = match last.class.opcode {
        Op::Branch => 0,
        Op::BranchConditional | Op::Switch => 1,
        _ => return vec![],
    };
    ids(last).skip(decided_by).collect()
}

/// The merge instruction of a block that heads a loop or a selection.
fn merge_of(block: &Block) -> Option<&Instruction> {
    let before_last = block.instructions.iter().rev().nth(1)?;
    matches!(before_last.class.opcode, Op::LoopMerge | Op::SelectionMerge).then_some(before_last)
}

/// The values of no meaning, one for each type.
struct Undefined {
    ids: HashMap<Word, Word>,
    new: Vec<(Word, Word)>,
}

impl Undefined {
    fn id(&mut self, kind: Word, constants: &mut Constants) -> Word {
        *self.ids.entry(kind).or_insert_with(|| {
            let id = constants.fresh();
            self.new.push((kind, id));
            id
        })
    }
}

/// Removes instructions that nothing needs.
fn remove_unused(function: &mut Function) {
    let instructions: Vec<&Instruction> =
        function.blocks.iter().flat_map(|block| &block.instructions).collect();
    let by_id: HashMap<Word, &Instruction> =
        instructions.iter().filter_map(|i| Some((i.result_id?, *i))).collect();
    let mut needed: HashSet<Word> = HashSet::new();
    let mut waiting: Vec<Word> =
        instructions.iter().filter(|instruction| has_effect(instruction)).flat_map(|i| operands(i)).collect();
    while let Some(id) = waiting.pop() {
        if needed.insert(id)
            && let Some(instruction) = by_id.get(&id)
        {
            waiting.extend(operands(instruction));
        }
    }
    for block in &mut function.blocks {
        block.instructions.retain(|i| has_effect(i) || i.result_id.is_some_and(|id| needed.contains(&id)));
    }
}

/// All ids that an instruction names.
fn operands(instruction: &Instruction) -> impl Iterator<Item = Word> {
    instruction.operands.iter().filter_map(Operand::id_ref_any)
}

/// Whether an instruction does more than give a result.
fn has_effect(instruction: &Instruction) -> bool {
    instruction.result_id.is_none()
        || matches!(
            instruction.class.opcode,
            Op::FunctionCall
                | Op::AtomicLoad
                | Op::AtomicExchange
                | Op::AtomicCompareExchange
                | Op::AtomicIIncrement
                | Op::AtomicIDecrement
                | Op::AtomicIAdd
                | Op::AtomicISub
                | Op::AtomicSMin
                | Op::AtomicUMin
                | Op::AtomicSMax
                | Op::AtomicUMax
                | Op::AtomicAnd
                | Op::AtomicOr
                | Op::AtomicXor
        )
}
