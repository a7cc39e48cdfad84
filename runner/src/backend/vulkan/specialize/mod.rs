//! Specialisation of a kernel before a driver sees it.
//!
//! A kernel holds the code of all methods, formats and features; a pipeline needs that of one choice among them. Given
//! a module and the values of its specialisation constants a driver reads and transforms all of it before it finds out
//! what it can leave out: lavapipe takes 20 times as long for `render` as for what is left of it, NVIDIA's driver
//! several times. So the choice is made here: constants take their values, what they decide is computed, branches that
//! are never taken are removed with the code behind them.
//!
//! Values are found by sparse conditional constant propagation (Wegman and Zadeck, "Constant Propagation with
//! Conditional Branches", TOPLAS 13(2), 1991; see `propagate.rs`). Branches are removed such that control flow stays
//! structured as the SPIR-V specification has it (section 2.11; see `prune.rs`).

mod fold;
mod propagate;
mod prune;

use rspirv::binary::{Assemble, ParseState};
use rspirv::dr::{Instruction, Module, Operand, load_words};
use rspirv::spirv::{Decoration, Op, Word};
use std::collections::HashMap;

/// The module with specialisation constant number `id` set to `values[id]`, and without the code that none of its
/// invocations runs then. Constants beyond `values` keep their defaults.
///
/// Fails where `words` is no SPIR-V module.
pub fn specialize(words: &[u32], values: &[u32]) -> Result<Vec<u32>, ParseState> {
    let mut module = load_words(words)?;
    freeze(&mut module, values);
    let mut constants = Constants::new(&module);
    for function in 0..module.functions.len() {
        let found = propagate::propagate(&module.functions[function], &constants);
        prune::prune(&mut module, function, &found, &mut constants);
    }
    constants.declare(&mut module);
    drop_names(&mut module);
    Ok(module.assemble())
}

/// The module with nothing that keeps a driver from fusing a product with a sum: what is not exact, to measure what
/// that costs and what drivers do.
///
/// Fails where `words` is no SPIR-V module.
pub fn let_contract(words: &[u32]) -> Result<Vec<u32>, ParseState> {
    let mut module = load_words(words)?;
    let no_contraction = Operand::Decoration(Decoration::NoContraction);
    module.annotations.retain(|annotation| !annotation.operands.contains(&no_contraction));
    Ok(module.assemble())
}

/// How many instructions the functions of a module have, labels and variables among them.
pub fn instructions(words: &[u32]) -> u32 {
    const HEADER_WORDS: usize = 5;
    let mut rest = words.get(HEADER_WORDS..).unwrap_or_default();
    let (mut count, mut in_functions) = (0, false);
    while let [first, ..] = *rest {
        // An instruction's first word: how many it has, and which it is.
        let (length, op) = ((first >> 16) as usize, first & 0xffff);
        in_functions |= op == Op::Function as u32;
        count += u32::from(in_functions);
        rest = rest.get(length.max(1)..).unwrap_or_default();
    }
    count
}

/// Makes constants of specialisation constants.
fn freeze(module: &mut Module, values: &[u32]) {
    let mut ids = HashMap::new();
    module.annotations.retain(|annotation| match annotation.operands[..] {
        [Operand::IdRef(id), Operand::Decoration(Decoration::SpecId), Operand::LiteralBit32(number)] => {
            ids.insert(id, number);
            false
        }
        _ => true,
    });
    for global in &mut module.types_global_values {
        let number = global.result_id.and_then(|id| ids.get(&id));
        if let Some(&value) = number.and_then(|&number| values.get(number as usize))
            && global.class.opcode == Op::SpecConstant
        {
            *global = Instruction::new(
                Op::Constant,
                global.result_type,
                global.result_id,
                vec![Operand::LiteralBit32(value)],
            );
        }
    }
}

/// Removes names and decorations of what is no longer there.
fn drop_names(module: &mut Module) {
    let there: std::collections::HashSet<Word> =
        module.all_inst_iter().filter_map(|instruction| instruction.result_id).collect();
    let is_there = |instruction: &Instruction| match instruction.operands.first() {
        Some(Operand::IdRef(id)) => there.contains(id),
        _ => true,
    };
    module.annotations.retain(is_there);
    module.debug_names.retain(is_there);
}

/// The scalar constants of a module, of 32 bits and truth values: these as 0 and 1, floats as their bits.
pub(super) struct Constants {
    /// The value of each by its id.
    values: HashMap<Word, u32>,
    /// The id of each type and value.
    ids: HashMap<(Word, u32), Word>,
    /// Those that the module does not declare yet: type, value, id.
    new: Vec<(Word, u32, Word)>,
    truth: Option<Word>,
    /// The first id that nothing has.
    bound: Word,
}

impl Constants {
    fn new(module: &Module) -> Constants {
        let bound = module.header.as_ref().map_or(0, |header| header.bound);
        let truth = module.types_global_values.iter().find(|global| global.class.opcode == Op::TypeBool);
        let mut constants = Constants {
            values: HashMap::new(),
            ids: HashMap::new(),
            new: Vec::new(),
            truth: truth.and_then(|global| global.result_id),
            bound,
        };
        for global in &module.types_global_values {
            let value = match (global.class.opcode, &global.operands[..]) {
                (Op::ConstantTrue, _) => 1,
                (Op::ConstantFalse, _) => 0,
                (Op::Constant, &[Operand::LiteralBit32(value)]) => value,
                _ => continue,
            };
            if let (Some(kind), Some(id)) = (global.result_type, global.result_id) {
                constants.values.insert(id, value);
                constants.ids.entry((kind, value)).or_insert(id);
            }
        }
        constants
    }

    /// An id for something new.
    fn fresh(&mut self) -> Word {
        self.bound += 1;
        self.bound - 1
    }

    /// The id of a constant.
    fn id(&mut self, kind: Word, value: u32) -> Word {
        if let Some(&id) = self.ids.get(&(kind, value)) {
            return id;
        }
        let id = self.fresh();
        self.ids.insert((kind, value), id);
        self.new.push((kind, value, id));
        id
    }

    /// Declares what is new.
    fn declare(&self, module: &mut Module) {
        for &(kind, value, id) in &self.new {
            let (op, operands) = match (self.truth == Some(kind), value) {
                (true, 0) => (Op::ConstantFalse, vec![]),
                (true, _) => (Op::ConstantTrue, vec![]),
                (false, _) => (Op::Constant, vec![Operand::LiteralBit32(value)]),
            };
            module.types_global_values.push(Instruction::new(op, Some(kind), Some(id), operands));
        }
        if let Some(header) = &mut module.header {
            header.bound = self.bound;
        }
    }
}

#[cfg(test)]
mod built;
#[cfg(test)]
pub(super) mod tests {
    use super::propagate::{ids, label};
    use super::*;
    use emboss_kernels::interface::{binding, method, spec};
    use emboss_kernels::scene::Features;
    use std::collections::{BTreeSet, HashSet};
    use std::io::Cursor;

    const RENDER: &[u8] = include_bytes!("../../../../../assets/kernels/render.spv");
    const PRISM_BOUNDS: &[u8] = include_bytes!("../../../../../assets/kernels/prism_bounds.spv");
    const TESSELLATE: &[u8] = include_bytes!("../../../../../assets/kernels/tessellate.spv");
    const TRACE_RAYS: &[u8] = include_bytes!("../../../../../assets/kernels/trace_rays.spv");

    fn words(module: &[u8]) -> Vec<u32> {
        ash::util::read_spv(&mut Cursor::new(module)).unwrap()
    }

    fn specialized(module: &[u8], features: Features) -> Module {
        load_words(specialize(&words(module), &features.to_array()).unwrap()).unwrap()
    }

    /// Control flow is whole: what is named is there, each block's phis have an operand for each block that leads to it
    /// and no other, and each loop has a branch back.
    fn assert_whole(module: &Module) {
        let there: HashSet<Word> = module.all_inst_iter().filter_map(|i| i.result_id).collect();
        for instruction in module.all_inst_iter() {
            let named = instruction.operands.iter().filter_map(Operand::id_ref_any);
            named.for_each(|id| assert!(there.contains(&id), "{instruction:?}"));
        }
        let blocks = &module.functions[0].blocks;
        let mut leading: HashMap<Word, BTreeSet<Word>> = HashMap::new();
        for block in blocks {
            let last = block.instructions.last().unwrap();
            let skipped = usize::from(last.class.opcode != Op::Branch);
            let targets = ids(last).skip(skipped).filter(|_| last.class.opcode != Op::Return);
            targets.for_each(|target| {
                leading.entry(target).or_default().insert(label(block).unwrap());
            });
        }
        for block in blocks {
            let own = label(block).unwrap();
            for phi in block.instructions.iter().filter(|i| i.class.opcode == Op::Phi) {
                let from: BTreeSet<Word> = ids(phi).skip(1).step_by(2).collect();
                assert_eq!(Some(&from), leading.get(&own), "{phi:?}");
            }
            for merge in block.instructions.iter().filter(|i| i.class.opcode == Op::LoopMerge) {
                let target = ids(merge).nth(1).unwrap();
                let from_there = blocks.iter().skip_while(|block| label(block) != Some(target));
                let back = from_there.filter(|block| leading[&own].contains(&label(block).unwrap())).count();
                assert_eq!(back, 1, "a loop is led back to from its continue construct");
            }
        }
    }

    /// Some choices of features, each value of each among them.
    pub(in super::super) fn choices() -> Vec<Features> {
        let choice = |i: u32| {
            let bit = |shift: u32| (i >> shift) & 1;
            let method = i % 16;
            Features {
                method,
                shade: i % 7,
                shadows: bit(1),
                height_format: (i + i / 16) % 4,
                color_format: (i / 4) % 4,
                height_wrap: (i / 2) % 4,
                color_wrap: (i / 3) % 4,
                counters: bit(2),
                normals: bit(3),
                seams: bit(1),
                smooth: bit(4),
                displacement: if method::takes_vectors(method) { (i / 16) % 3 } else { 0 },
                filter: bit(2),
                adaptive: if method::takes_any_scene(method) { bit(4) } else { 0 },
                instances: if method == method::TESSELLATE { 0 } else { bit(3) },
                bounds: (i / 16) % 3,
            }
        };
        (0..48).map(choice).collect()
    }

    #[test]
    fn control_flow_stays_whole_for_all_features() {
        for features in choices() {
            for module in [RENDER, TRACE_RAYS, PRISM_BOUNDS, TESSELLATE] {
                assert_whole(&specialized(module, features));
            }
        }
    }

    #[test]
    fn nothing_is_left_to_specialise() {
        let module = specialized(RENDER, Features::default());
        let left = module.all_inst_iter().filter(|i| i.class.opcode == Op::SpecConstant).count();
        assert_eq!(left, 0);
        let ids_left = module.annotations.iter().any(|i| i.operands.contains(&Decoration::SpecId.into()));
        assert!(!ids_left);
        assert!(Features::default().to_array().len() == spec::COUNT as usize);
    }

    /// The results of sums, products and quotients of floats, and those of them that no driver may fuse.
    fn arithmetic(module: &Module) -> [HashSet<Word>; 2] {
        let is_one = |i: &&Instruction| matches!(i.class.opcode, Op::FAdd | Op::FSub | Op::FMul | Op::FDiv);
        let results = module.all_inst_iter().filter(is_one).filter_map(|i| i.result_id);
        let is_kept = |i: &&Instruction| i.operands.contains(&Decoration::NoContraction.into());
        let kept = module.annotations.iter().filter(is_kept).filter_map(|i| i.operands[0].id_ref_any());
        [results.collect(), kept.collect()]
    }

    #[test]
    fn what_is_left_cannot_be_fused_unless_it_may() {
        for features in choices() {
            let module = specialized(RENDER, features);
            let [results, kept] = arithmetic(&module);
            assert!(!results.is_empty() && results.is_subset(&kept), "{features:?}");
        }
        let free = load_words(let_contract(&words(TRACE_RAYS)).unwrap()).unwrap();
        let [results, kept] = arithmetic(&free);
        assert!(results.len() > 1000 && kept.is_empty());
        assert_eq!(free.functions.len(), load_words(words(TRACE_RAYS)).unwrap().functions.len());
    }

    /// The bindings that code is left for.
    fn bindings(module: &Module) -> BTreeSet<u32> {
        let used: HashSet<Word> = module.functions[0]
            .all_inst_iter()
            .flat_map(|i| i.operands.iter().filter_map(Operand::id_ref_any))
            .collect();
        let binding = |annotation: &Instruction| match annotation.operands[..] {
            [Operand::IdRef(id), Operand::Decoration(Decoration::Binding), Operand::LiteralBit32(number)] => {
                used.contains(&id).then_some(number)
            }
            _ => None,
        };
        module.annotations.iter().filter_map(binding).collect()
    }

    /// What a scene does not use its pipeline has no code for.
    #[test]
    fn what_is_not_chosen_is_absent() {
        let features = Features { method: method::NONE, ..Features::default() };
        let flat = bindings(&specialized(RENDER, features));
        for absent in [binding::HEIGHT_TEXELS, binding::HEIGHT_RANGES, binding::SEAMS, binding::INSTANCES] {
            assert!(!flat.contains(&absent), "{absent}");
        }
        let placed = Features { instances: 1, ..features };
        assert!(bindings(&specialized(RENDER, placed)).contains(&binding::INSTANCES));
        let count = |features| specialized(RENDER, features).all_inst_iter().count();
        let whole = load_words(words(RENDER)).unwrap().all_inst_iter().count();
        let exact = count(Features { method: method::QUADTREE, shadows: 1, ..features });
        // All code of the exact method is less than a fifth of the whole, that of no method less than half of this.
        assert!(5 * exact < whole, "{exact} of {whole}");
        assert!(2 * count(features) < exact);
    }
}
