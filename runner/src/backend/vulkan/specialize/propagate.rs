//! Which values of a function are constant, and which of its blocks are ever run.

use super::Constants;
use super::fold::fold;
use rspirv::dr::{Block, Function, Instruction, Operand};
use rspirv::spirv::{Op, Word};
use std::collections::{HashMap, HashSet};

/// What is known of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lattice {
    /// Nothing yet.
    Unknown,
    /// It is always this: see [`Constants`].
    Constant(u32),
    /// It may be anything.
    Varying,
}

impl Lattice {
    /// What is known of a value that may be either.
    pub(super) fn meet(self, other: Lattice) -> Lattice {
        match (self, other) {
            (Lattice::Unknown, known) | (known, Lattice::Unknown) => known,
            (a, b) if a == b => a,
            _ => Lattice::Varying,
        }
    }
}

/// What is known of a function.
pub(super) struct Found {
    /// The constants among the results of its instructions.
    pub(super) constants: HashMap<Word, u32>,
    /// The labels of the blocks that may be run.
    pub(super) reachable: HashSet<Word>,
    /// The branches that may be taken, from label to label.
    pub(super) edges: HashSet<(Word, Word)>,
}

/// Finds out what is constant in `function`: all values are taken for unknown and all branches for untaken until the
/// contrary is seen, so that a loop whose second turn never comes has constants too.
pub(super) fn propagate(function: &Function, module: &Constants) -> Found {
    let mut state =
        State { module, values: HashMap::new(), reachable: HashSet::new(), edges: HashSet::new() };
    if let Some(entry) = function.blocks.first().and_then(label) {
        state.reachable.insert(entry);
    }
    for block in &function.blocks {
        for id in block.instructions.iter().filter_map(|instruction| instruction.result_id) {
            state.values.insert(id, Lattice::Unknown);
        }
    }
    // Each turn moves some value down, which each can twice, or takes a branch. Blocks stand behind those that dominate
    // them, so that a few turns do.
    while state.turn(function) {}
    let constants = state.values.iter().filter_map(|(&id, value)| match value {
        Lattice::Constant(value) => Some((id, *value)),
        _ => None,
    });
    Found { constants: constants.collect(), reachable: state.reachable, edges: state.edges }
}

/// The label of a block.
pub(super) fn label(block: &Block) -> Option<Word> {
    block.label.as_ref().and_then(|label| label.result_id)
}

/// The ids that an instruction names, in order.
pub(super) fn ids(instruction: &Instruction) -> impl Iterator<Item = Word> {
    instruction.operands.iter().filter_map(|operand| match operand {
        Operand::IdRef(id) => Some(*id),
        _ => None,
    })
}

struct State<'a> {
    module: &'a Constants,
    values: HashMap<Word, Lattice>,
    reachable: HashSet<Word>,
    edges: HashSet<(Word, Word)>,
}

impl State<'_> {
    /// Looks at all that may be run; whether anything new was seen.
    fn turn(&mut self, function: &Function) -> bool {
        let mut changed = false;
        for block in &function.blocks {
            let Some(label) = label(block).filter(|label| self.reachable.contains(label)) else { continue };
            for instruction in &block.instructions {
                if let Some(id) = instruction.result_id {
                    let new = self.value(instruction, label);
                    changed |= self.values.insert(id, new) != Some(new);
                }
            }
            let targets = block.instructions.last().map_or(vec![], |last| self.targets(last));
            for target in targets {
                changed |= self.edges.insert((label, target));
                self.reachable.insert(target);
            }
        }
        changed
    }

    fn of(&self, id: Word) -> Lattice {
        match self.module.values.get(&id) {
            Some(&value) => Lattice::Constant(value),
            // What is declared outside of the function, and its parameters, may be anything.
            None => self.values.get(&id).copied().unwrap_or(Lattice::Varying),
        }
    }

    /// What is known of the result of an instruction of the block with this label.
    fn value(&self, instruction: &Instruction, label: Word) -> Lattice {
        let op = instruction.class.opcode;
        let operands: Vec<Word> = ids(instruction).collect();
        if op == Op::Phi {
            let taken = operands.chunks(2).filter(|pair| self.edges.contains(&(pair[1], label)));
            return taken.fold(Lattice::Unknown, |known, pair| known.meet(self.of(pair[0])));
        }
        let known: Vec<Lattice> = operands.iter().map(|&id| self.of(id)).collect();
        fold(op, &known)
    }

    /// Where a block may go on after its last instruction.
    fn targets(&self, last: &Instruction) -> Vec<Word> {
        let operands: Vec<Word> = ids(last).collect();
        match (last.class.opcode, &operands[..]) {
            (Op::BranchConditional, &[condition, yes, no]) => match self.of(condition) {
                Lattice::Unknown => vec![],
                Lattice::Constant(0) => vec![no],
                Lattice::Constant(_) => vec![yes],
                Lattice::Varying => vec![yes, no],
            },
            (Op::Branch, &[target]) => vec![target],
            // Switches are few: all their cases are kept.
            (Op::Switch, [_, targets @ ..]) => targets.to_vec(),
            _ => vec![],
        }
    }
}
