//! What instructions give for constant operands.

use super::propagate::Lattice;
use rspirv::spirv::Op;

/// What `op` gives for these operands, where it is known of 32-bit scalars and truth values. Arithmetic of floats is
/// left to the device, which may round in its own way; comparisons of theirs are exact.
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

#[cfg(test)]
mod tests {
    use super::*;
    use Lattice::{Constant, Unknown, Varying};

    fn folded(op: Op, operands: &[u32]) -> Lattice {
        fold(op, &operands.iter().copied().map(Constant).collect::<Vec<_>>())
    }

    /// Rust's own operators say what SPIR-V's are to give, for operands at which signs, carries and order show.
    #[test]
    fn integers_are_computed_as_the_device_would() {
        const VALUES: [u32; 7] = [0, 1, 2, 31, 0x7fff_ffff, 0x8000_0000, u32::MAX];
        type Expected = fn(u32, u32) -> u32;
        let operations: [(Op, Expected); 19] = [
            (Op::IAdd, u32::wrapping_add),
            (Op::ISub, u32::wrapping_sub),
            (Op::IMul, u32::wrapping_mul),
            (Op::BitwiseAnd, |a, b| a & b),
            (Op::BitwiseOr, |a, b| a | b),
            (Op::BitwiseXor, |a, b| a ^ b),
            (Op::IEqual, |a, b| u32::from(a == b)),
            (Op::INotEqual, |a, b| u32::from(a != b)),
            (Op::ULessThan, |a, b| u32::from(a < b)),
            (Op::ULessThanEqual, |a, b| u32::from(a <= b)),
            (Op::UGreaterThan, |a, b| u32::from(a > b)),
            (Op::UGreaterThanEqual, |a, b| u32::from(a >= b)),
            (Op::SLessThan, |a, b| u32::from((a as i32) < b as i32)),
            (Op::SLessThanEqual, |a, b| u32::from(a as i32 <= b as i32)),
            (Op::SGreaterThan, |a, b| u32::from(a as i32 > b as i32)),
            (Op::SGreaterThanEqual, |a, b| u32::from(a as i32 >= b as i32)),
            // All values but these two are out of their range.
            (Op::LogicalAnd, |a, b| a & b),
            (Op::LogicalOr, |a, b| a | b),
            (Op::LogicalNotEqual, |a, b| u32::from(a != b)),
        ];
        for (op, expected) in operations {
            let is_of_truth = matches!(op, Op::LogicalAnd | Op::LogicalOr | Op::LogicalNotEqual);
            let values = if is_of_truth { &VALUES[..2] } else { &VALUES };
            for (&a, &b) in values.iter().flat_map(|a| values.iter().map(move |b| (a, b))) {
                assert_eq!(folded(op, &[a, b]), Constant(expected(a, b)), "{op:?} {a} {b}");
            }
        }
        assert_eq!(folded(Op::ShiftLeftLogical, &[3, 31]), Constant(0x8000_0000));
        assert_eq!(folded(Op::ShiftRightLogical, &[0x8000_0000, 31]), Constant(1));
        for shift in [Op::ShiftLeftLogical, Op::ShiftRightLogical] {
            assert_eq!(folded(shift, &[1, 32]), Varying, "undefined");
        }
        assert_eq!(folded(Op::LogicalNot, &[0]), Constant(1));
        assert_eq!(folded(Op::LogicalNot, &[1]), Constant(0));
        assert_eq!(folded(Op::Not, &[5]), Constant(!5));
        assert_eq!(folded(Op::SNegate, &[0x8000_0000]), Constant(0x8000_0000));
        assert_eq!(folded(Op::Bitcast, &[7]), Constant(7));
    }

    /// Ordered comparisons with NaN are false, unordered ones true; zeros of both signs are equal; what a device may
    /// flush to zero, and arithmetic, are left to it.
    #[test]
    fn floats_are_compared_and_nothing_else() {
        type Expected = fn(f32, f32) -> bool;
        let operations: [(Op, Op, Expected); 6] = [
            (Op::FOrdEqual, Op::FUnordEqual, |a, b| a == b),
            (Op::FOrdNotEqual, Op::FUnordNotEqual, |a, b| a != b),
            (Op::FOrdLessThan, Op::FUnordLessThan, |a, b| a < b),
            (Op::FOrdLessThanEqual, Op::FUnordLessThanEqual, |a, b| a <= b),
            (Op::FOrdGreaterThan, Op::FUnordGreaterThan, |a, b| a > b),
            (Op::FOrdGreaterThanEqual, Op::FUnordGreaterThanEqual, |a, b| a >= b),
        ];
        let values = [0.0, -0.0, 1.5, -1.5, f32::INFINITY, f32::NAN];
        for (ordered, unordered, expected) in operations {
            for (a, b) in values.iter().flat_map(|&a| values.map(|b| (a, b))) {
                let is_unordered = a.is_nan() || b.is_nan();
                let bits = [a.to_bits(), b.to_bits()];
                let is_true = expected(a, b);
                assert_eq!(
                    folded(ordered, &bits),
                    Constant(u32::from(!is_unordered && is_true)),
                    "{ordered:?} {a} {b}"
                );
                assert_eq!(
                    folded(unordered, &bits),
                    Constant(u32::from(is_unordered || is_true)),
                    "{unordered:?} {a} {b}"
                );
            }
            assert_eq!(folded(ordered, &[1, 0]), Varying, "subnormal");
        }
        assert_eq!(folded(Op::FAdd, &[0, 0]), Varying);
    }

    #[test]
    fn one_operand_may_decide_and_what_is_not_known_may_come_to_be() {
        for unknown in [Unknown, Varying] {
            assert_eq!(fold(Op::LogicalAnd, &[Constant(0), unknown]), Constant(0));
            assert_eq!(fold(Op::LogicalOr, &[unknown, Constant(1)]), Constant(1));
            assert_eq!(fold(Op::IMul, &[unknown, Constant(0)]), Constant(0));
            assert_eq!(fold(Op::LogicalAnd, &[Constant(1), unknown]), unknown);
            assert_eq!(fold(Op::Select, &[Constant(1), Constant(4), unknown]), Constant(4));
            assert_eq!(fold(Op::Select, &[Constant(0), Constant(4), unknown]), unknown);
        }
        assert_eq!(fold(Op::Select, &[Varying, Constant(4), Constant(4)]), Constant(4));
        assert_eq!(fold(Op::Select, &[Varying, Constant(4), Constant(5)]), Varying);
        assert_eq!(fold(Op::IAdd, &[Unknown, Varying]), Unknown);
    }
}
