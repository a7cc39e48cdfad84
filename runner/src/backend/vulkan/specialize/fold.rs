//! What instructions give for constant operands.

use super::propagate::Lattice;
use rspirv::spirv::Op;

/// What `op` gives for these operands, where it is known of 32-bit scalars and truth values. Arithmetic of floats is left to
/// the device, which may round in its own way; comparisons of theirs are exact.
pub(super) fn fold(op: Op, operands: &[Lattice]) -> Lattice {
    use Lattice::{Constant, Unknown, Varying};
    // What one operand alone decides.
    match (op, operands) {
        (Op::LogicalAnd, [Constant(0), _] | [_, Constant(0)]) => return Constant(0),
        (Op::LogicalOr, [Constant(1), _] | [_, Constant(1)]) => return Constant(1),
        (Op::BitwiseAnd | Op::IMul, [Constant(0), _] | [_, Constant(0)]) => return Constant(0),
        (Op::Select, [Constant(chosen), yes, no]) => return if *chosen != 0 { *yes } else { *no },
        (Op::Select, [Varying, yes, no]) => return yes.meet(*no),
        _ => {}
    }
    match *operands {
        // First of all, so that what is found never goes back from varying to constant.
        _ if operands.contains(&Unknown) => Unknown,
        [Constant(a)] => unary(op, a).map_or(Varying, Constant),
        [Constant(a), Constant(b)] => binary(op, a, b).map_or(Varying, Constant),
        _ => Varying,
    }
}

fn unary(op: Op, a: u32) -> Option<u32> {
    match op {
        Op::CopyObject | Op::Bitcast => Some(a),
        Op::LogicalNot => Some(1 - a),
        Op::Not => Some(!a),
        Op::SNegate => Some(a.wrapping_neg()),
        _ => None,
    }
}

fn binary(op: Op, a: u32, b: u32) -> Option<u32> {
    let (sa, sb) = (a.cast_signed(), b.cast_signed());
    let (fa, fb) = (f32::from_bits(a), f32::from_bits(b));
    let unordered = fa.is_nan() || fb.is_nan();
    // A device may take a subnormal number for 0.
    let inexact = fa.is_subnormal() || fb.is_subnormal();
    let integer = match op {
        Op::IAdd => a.wrapping_add(b),
        Op::ISub => a.wrapping_sub(b),
        Op::IMul => a.wrapping_mul(b),
        Op::BitwiseAnd => a & b,
        Op::BitwiseOr => a | b,
        Op::BitwiseXor => a ^ b,
        // Shifts by more are undefined.
        Op::ShiftLeftLogical if b < 32 => a << b,
        Op::ShiftRightLogical if b < 32 => a >> b,
        Op::LogicalAnd => a & b,
        Op::LogicalOr => a | b,
        Op::IEqual | Op::LogicalEqual => u32::from(a == b),
        Op::INotEqual | Op::LogicalNotEqual => u32::from(a != b),
        Op::ULessThan => u32::from(a < b),
        Op::ULessThanEqual => u32::from(a <= b),
        Op::UGreaterThan => u32::from(a > b),
        Op::UGreaterThanEqual => u32::from(a >= b),
        Op::SLessThan => u32::from(sa < sb),
        Op::SLessThanEqual => u32::from(sa <= sb),
        Op::SGreaterThan => u32::from(sa > sb),
        Op::SGreaterThanEqual => u32::from(sa >= sb),
        _ if inexact => return None,
        Op::FOrdEqual => u32::from(fa == fb),
        Op::FOrdNotEqual => u32::from(!unordered && fa != fb),
        Op::FOrdLessThan => u32::from(fa < fb),
        Op::FOrdLessThanEqual => u32::from(fa <= fb),
        Op::FOrdGreaterThan => u32::from(fa > fb),
        Op::FOrdGreaterThanEqual => u32::from(fa >= fb),
        Op::FUnordEqual => u32::from(unordered || fa == fb),
        Op::FUnordNotEqual => u32::from(fa != fb),
        Op::FUnordLessThan => u32::from(unordered || fa < fb),
        Op::FUnordLessThanEqual => u32::from(unordered || fa <= fb),
        Op::FUnordGreaterThan => u32::from(unordered || fa > fb),
        Op::FUnordGreaterThanEqual => u32::from(unordered || fa >= fb),
        _ => return None,
    };
    Some(integer)
}
