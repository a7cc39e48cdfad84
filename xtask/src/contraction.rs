//! `NoContraction` on the arithmetic of modules: no driver may fuse a product with a sum.
//!
//! Without it a driver fuses what it likes: NVIDIA's fuses a product with a sum unless the product has another use, so
//! that two pipelines with the same formula get different bits. Where a sum is to be fused kernels say so, by
//! `Fma`.

use crate::settings::DECORATION;
use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Op, Word};
use std::collections::HashSet;

/// Whether an instruction computes with floats such that a driver may combine it with another one. A quotient is one:
/// by a constant it becomes a product.
pub fn is_arithmetic(op: Op) -> bool {
    matches!(
        op,
        Op::FAdd
            | Op::FSub
            | Op::FMul
            | Op::FDiv
            | Op::FRem
            | Op::FMod
            | Op::FNegate
            | Op::Dot
            | Op::VectorTimesScalar
            | Op::MatrixTimesScalar
            | Op::VectorTimesMatrix
            | Op::MatrixTimesVector
            | Op::MatrixTimesMatrix
            | Op::OuterProduct
    )
}

/// The results of arithmetic in a module, in its order.
fn results(module: &Module) -> impl Iterator<Item = Word> {
    let is_one = |instruction: &&Instruction| is_arithmetic(instruction.class.opcode);
    module.all_inst_iter().filter(is_one).filter_map(|instruction| instruction.result_id)
}

/// The results in a module that are decorated.
fn decorated(module: &Module) -> HashSet<Word> {
    let target = |annotation: &Instruction| match annotation.operands[..] {
        [Operand::IdRef(id), Operand::Decoration(DECORATION)] if annotation.class.opcode == Op::Decorate => {
            Some(id)
        }
        _ => None,
    };
    module.annotations.iter().filter_map(target).collect()
}

/// The results of arithmetic that a driver may combine with others.
pub fn contractible(module: &Module) -> Vec<Word> {
    let decorated = decorated(module);
    results(module).filter(|id| !decorated.contains(id)).collect()
}

/// Decorates all arithmetic of a module.
pub fn forbid(module: &mut Module) {
    let decorations = contractible(module).into_iter().map(|id| {
        let operands = vec![Operand::IdRef(id), Operand::Decoration(DECORATION)];
        Instruction::new(Op::Decorate, None, None, operands)
    });
    let decorations: Vec<Instruction> = decorations.collect();
    module.annotations.extend(decorations);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rspirv::dr::Builder;
    use rspirv::spirv::FunctionControl;

    /// a * b + a and a quotient, of which the product is decorated already.
    #[test]
    fn all_arithmetic_is_decorated_once() {
        let mut builder = Builder::new();
        let (void, float) = (builder.type_void(), builder.type_float(32, None));
        let kind = builder.type_function(void, []);
        let a = builder.constant_bit32(float, 1.5_f32.to_bits());
        builder.begin_function(void, None, FunctionControl::NONE, kind).unwrap();
        builder.begin_block(None).unwrap();
        let product = builder.f_mul(float, None, a, a).unwrap();
        let sum = builder.f_add(float, None, product, a).unwrap();
        let quotient = builder.f_div(float, None, sum, a).unwrap();
        builder.ret().unwrap();
        builder.end_function().unwrap();
        builder.decorate(product, DECORATION, []);
        let mut module = builder.module();
        assert_eq!(contractible(&module), [sum, quotient]);
        forbid(&mut module);
        assert!(contractible(&module).is_empty());
        assert_eq!(module.annotations.len(), 3);
        let before = module.clone();
        forbid(&mut module);
        assert_eq!(module.annotations, before.annotations);
    }
}
