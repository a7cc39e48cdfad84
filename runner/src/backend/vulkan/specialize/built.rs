//! The specialiser on functions that are built by hand: cases that the kernels of today may not have.

use super::specialize;
use rspirv::binary::Assemble;
use rspirv::dr::{Builder, InsertPoint, Instruction, Module, Operand, load_words};
use rspirv::spirv::{
    AddressingModel, Capability, Decoration, FunctionControl, LoopControl, MemoryModel, Op, SelectionControl,
    StorageClass, Word,
};

/// A module with one function, which stores into a private variable; its body is still to be built.
struct Built {
    builder: Builder,
    boolean: Word,
    word: Word,
    /// The label of the first block.
    entry: Word,
    /// Whether specialisation constant 0 is 1.
    is_on: Word,
    variable: Word,
}

impl Built {
    fn new() -> Built {
        let mut builder = Builder::new();
        builder.set_version(1, 5);
        builder.capability(Capability::Shader);
        builder.memory_model(AddressingModel::Logical, MemoryModel::GLSL450);
        let (boolean, word, void) = (builder.type_bool(), builder.type_int(32, 0), builder.type_void());
        let pointer = builder.type_pointer(None, StorageClass::Private, word);
        let variable = builder.variable(pointer, None, StorageClass::Private, None);
        let choice = builder.spec_constant_bit32(word, 0);
        builder.decorate(choice, Decoration::SpecId, [Operand::LiteralBit32(0)]);
        let (one, kind) = (builder.constant_bit32(word, 1), builder.type_function(void, []));
        builder.begin_function(void, None, FunctionControl::NONE, kind).unwrap();
        let entry = builder.begin_block(None).unwrap();
        let is_on = builder.i_equal(boolean, None, choice, one).unwrap();
        Built { builder, boolean, word, entry, is_on, variable }
    }

    /// A truth value that may be either.
    fn varying(&mut self) -> Word {
        let some = self.builder.load(self.word, None, self.variable, None, []).unwrap();
        self.builder.i_equal(self.boolean, None, some, some).unwrap()
    }

    /// The module with specialisation constant 0 set to that.
    fn with(self, value: u32) -> Module {
        let words = self.builder.module().assemble();
        load_words(specialize(&words, &[value]).unwrap()).unwrap()
    }
}

fn of(module: &Module, op: Op) -> Vec<Instruction> {
    module.functions[0].all_inst_iter().filter(|i| i.class.opcode == op).cloned().collect()
}

/// The number that a constant's id stands for.
fn constant(module: &Module, id: &Operand) -> u32 {
    let declared = module.types_global_values.iter().find(|global| global.result_id == id.id_ref_any());
    match declared.map(|global| &global.operands[..]) {
        Some(&[Operand::LiteralBit32(value)]) => value,
        other => panic!("{id:?} is {other:?}"),
    }
}

/// 7 where the choice is on, else 8: of the two blocks and the phi behind them nothing is left but a store of the
/// number.
#[test]
fn a_phi_of_what_is_never_run_is_a_constant() {
    for (choice, expected) in [(1, 7), (0, 8)] {
        let mut built = Built::new();
        let [yes, no, merge] = std::array::from_fn(|_| built.builder.id());
        let numbers = [7, 8].map(|number| built.builder.constant_bit32(built.word, number));
        built.builder.selection_merge(merge, SelectionControl::NONE).unwrap();
        built.builder.branch_conditional(built.is_on, yes, no, []).unwrap();
        for block in [yes, no] {
            built.builder.begin_block(Some(block)).unwrap();
            built.builder.branch(merge).unwrap();
        }
        built.builder.begin_block(Some(merge)).unwrap();
        let phi = built.builder.phi(built.word, None, [(numbers[0], yes), (numbers[1], no)]).unwrap();
        built.builder.store(built.variable, phi, None, []).unwrap();
        built.builder.ret().unwrap();
        built.builder.end_function().unwrap();
        let module = built.with(choice);
        assert_eq!(of(&module, Op::Phi), []);
        assert_eq!(of(&module, Op::SelectionMerge), []);
        assert_eq!(module.functions[0].blocks.len(), 3);
        let [store] = &of(&module, Op::Store)[..] else { panic!("one store is left") };
        assert_eq!(constant(&module, &store.operands[1]), expected);
    }
}

/// A selection both of whose ways end the function has a merge block that nothing leads to: it stays, as a stub.
#[test]
fn a_merge_block_that_is_never_run_is_unreachable() {
    let mut built = Built::new();
    let [yes, no, merge] = std::array::from_fn(|_| built.builder.id());
    let condition = built.varying();
    built.builder.selection_merge(merge, SelectionControl::NONE).unwrap();
    built.builder.branch_conditional(condition, yes, no, []).unwrap();
    for block in [yes, no] {
        built.builder.begin_block(Some(block)).unwrap();
        built.builder.ret().unwrap();
    }
    built.builder.begin_block(Some(merge)).unwrap();
    let one = built.builder.constant_bit32(built.word, 1);
    built.builder.store(built.variable, one, None, []).unwrap();
    built.builder.ret().unwrap();
    built.builder.end_function().unwrap();
    let module = built.with(1);
    assert_eq!((of(&module, Op::Unreachable).len(), of(&module, Op::Store).len()), (1, 0));
    assert_eq!(of(&module, Op::SelectionMerge).len(), 1);
}

/// A loop that is left in its first turn where the choice is on: its continue target is never run, but stays to lead
/// back, and the header's phi has an undefined value from there.
#[test]
fn a_continue_target_that_is_never_run_leads_back() {
    let mut built = Built::new();
    let [header, body, again, merge] = std::array::from_fn(|_| built.builder.id());
    let one = built.builder.constant_bit32(built.word, 1);
    let first = built.builder.load(built.word, None, built.variable, None, []).unwrap();
    built.builder.branch(header).unwrap();
    let turn = built.builder.id();
    built.builder.begin_block(Some(header)).unwrap();
    let phi = built.builder.phi(built.word, None, [(first, built.entry), (turn, again)]).unwrap();
    built.builder.loop_merge(merge, again, LoopControl::NONE, []).unwrap();
    built.builder.branch(body).unwrap();
    built.builder.begin_block(Some(body)).unwrap();
    built.builder.store(built.variable, phi, None, []).unwrap();
    built.builder.branch_conditional(built.is_on, merge, again, []).unwrap();
    built.builder.begin_block(Some(again)).unwrap();
    built.builder.i_add(built.word, Some(turn), phi, one).unwrap();
    built.builder.branch(header).unwrap();
    built.builder.begin_block(Some(merge)).unwrap();
    built.builder.ret().unwrap();
    built.builder.end_function().unwrap();
    let module = built.with(1);
    let [phi] = &of(&module, Op::Phi)[..] else { panic!("the header's phi stays") };
    assert_eq!((phi.operands.len(), &phi.operands[3]), (4, &Operand::IdRef(again)));
    let undefined = module.types_global_values.iter().find(|i| i.class.opcode == Op::Undef).unwrap();
    assert_eq!(phi.operands[2].id_ref_any(), undefined.result_id);
    let stub = module.functions[0].blocks.iter().find(|b| b.label.as_ref().unwrap().result_id == Some(again));
    let back = &stub.unwrap().instructions[..];
    assert_eq!((back.len(), &back[0].operands), (1, &vec![Operand::IdRef(header)]));
    assert_eq!((of(&module, Op::IAdd).len(), of(&module, Op::Store).len()), (0, 1));
}

/// A value that takes over what another was in the turn before: where that changes in the second turn, it does in the
/// third.
#[test]
fn what_changes_in_a_later_turn_is_no_constant() {
    let mut built = Built::new();
    let [header, again, merge, ahead, next] = std::array::from_fn(|_| built.builder.id());
    let [zero, one] = [0, 1].map(|number| built.builder.constant_bit32(built.word, number));
    let condition = built.varying();
    built.builder.branch(header).unwrap();
    built.builder.begin_block(Some(header)).unwrap();
    let behind = built.builder.phi(built.word, None, [(zero, built.entry), (ahead, again)]).unwrap();
    built.builder.phi(built.word, Some(ahead), [(zero, built.entry), (next, again)]).unwrap();
    built.builder.loop_merge(merge, again, LoopControl::NONE, []).unwrap();
    built.builder.branch_conditional(condition, again, merge, []).unwrap();
    built.builder.begin_block(Some(again)).unwrap();
    built.builder.i_add(built.word, Some(next), ahead, one).unwrap();
    built.builder.branch(header).unwrap();
    built.builder.begin_block(Some(merge)).unwrap();
    built.builder.store(built.variable, behind, None, []).unwrap();
    built.builder.ret().unwrap();
    built.builder.end_function().unwrap();
    let module = built.with(1);
    let [store] = &of(&module, Op::Store)[..] else { panic!("the store is left") };
    assert_eq!((of(&module, Op::Phi).len(), store.operands[1].id_ref_any()), (2, Some(behind)));
}

/// A selection in a loop, neither of whose ways goes on: its merge block is the loop's continue target too.
#[test]
fn a_merge_block_that_is_a_continue_target_leads_back() {
    let mut built = Built::new();
    let [header, body, yes, no, again, merge] = std::array::from_fn(|_| built.builder.id());
    let condition = built.varying();
    built.builder.branch(header).unwrap();
    built.builder.begin_block(Some(header)).unwrap();
    built.builder.loop_merge(merge, again, LoopControl::NONE, []).unwrap();
    built.builder.branch(body).unwrap();
    built.builder.begin_block(Some(body)).unwrap();
    built.builder.selection_merge(again, SelectionControl::NONE).unwrap();
    built.builder.branch_conditional(condition, yes, no, []).unwrap();
    for block in [yes, no] {
        built.builder.begin_block(Some(block)).unwrap();
        built.builder.branch(merge).unwrap();
    }
    built.builder.begin_block(Some(again)).unwrap();
    built.builder.branch(header).unwrap();
    built.builder.begin_block(Some(merge)).unwrap();
    built.builder.ret().unwrap();
    built.builder.end_function().unwrap();
    let module = built.with(1);
    assert_eq!((of(&module, Op::Unreachable).len(), of(&module, Op::SelectionMerge).len()), (0, 1));
    let leads_back = |i: &&Instruction| i.operands == [Operand::IdRef(header)];
    assert_eq!(of(&module, Op::Branch).iter().filter(leads_back).count(), 2);
}

/// A selection that goes but one way, which ends the function, names no merge block any more.
#[test]
fn a_merge_block_that_nothing_names_is_gone() {
    let mut built = Built::new();
    let [yes, no, merge] = std::array::from_fn(|_| built.builder.id());
    built.builder.selection_merge(merge, SelectionControl::NONE).unwrap();
    built.builder.branch_conditional(built.is_on, yes, no, []).unwrap();
    for block in [yes, no, merge] {
        built.builder.begin_block(Some(block)).unwrap();
        built.builder.ret().unwrap();
    }
    built.builder.end_function().unwrap();
    let module = built.with(1);
    assert_eq!((of(&module, Op::Label).len(), of(&module, Op::Return).len()), (2, 1));
}

/// What nobody reads goes, but not where it does something beside: the atomic ones.
#[test]
fn what_has_an_effect_stays_without_a_reader() {
    let mut built = Built::new();
    let (scope, value) =
        (built.builder.constant_bit32(built.word, 5), built.builder.constant_bit32(built.word, 0));
    built.builder.load(built.word, None, built.variable, None, []).unwrap();
    let all = [
        Op::AtomicExchange,
        Op::AtomicIAdd,
        Op::AtomicISub,
        Op::AtomicSMin,
        Op::AtomicUMin,
        Op::AtomicSMax,
        Op::AtomicUMax,
        Op::AtomicAnd,
        Op::AtomicOr,
        Op::AtomicXor,
    ];
    for op in all {
        let operands = [
            Operand::IdRef(built.variable),
            Operand::IdScope(scope),
            Operand::IdMemorySemantics(value),
            Operand::IdRef(value),
        ];
        let id = built.builder.id();
        let atomic = Instruction::new(op, Some(built.word), Some(id), operands.into());
        built.builder.insert_into_block(InsertPoint::End, atomic).unwrap();
    }
    built.builder.ret().unwrap();
    built.builder.end_function().unwrap();
    let module = built.with(1);
    assert_eq!(of(&module, Op::Load), []);
    for op in all {
        assert_eq!(of(&module, op).len(), 1, "{op:?}");
    }
}
