//! What a SPIR-V module says of itself: entry points, specialisation constants, bindings.

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Decoration, ExecutionMode, Op, Word};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The interface of a SPIR-V module, each list in ascending order.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct Contents {
    /// Compute entry points by name.
    pub entry_points: BTreeMap<String, EntryPoint>,
    /// Default values of specialisation constants by id. Constants that no entry point reads are absent.
    pub spec_constants: BTreeMap<Word, Word>,
    /// Bindings of descriptor set 0 that an entry point uses.
    pub bindings: BTreeSet<Word>,
}

/// A compute entry point.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct EntryPoint {
    /// Threads of a workgroup along x, y and z.
    pub workgroup: [Word; 3],
}

/// What keeps a module from being read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModuleError {
    /// The bytes are no SPIR-V module.
    #[error("not a SPIR-V module: {reason}")]
    Malformed {
        /// Why.
        reason: String,
    },
}

/// Parses a module.
pub fn parse(bytes: &[u8]) -> Result<Module, ModuleError> {
    rspirv::dr::load_bytes(bytes).map_err(|state| ModuleError::Malformed { reason: state.to_string() })
}

/// The interface of a module.
pub fn contents(module: &Module) -> Contents {
    Contents {
        entry_points: entry_points(module),
        spec_constants: spec_constants(module),
        bindings: decorated(module, Decoration::Binding).map(|(_, binding)| binding).collect(),
    }
}

/// Ids that carry a decoration with a number, and the number.
pub fn decorated(module: &Module, wanted: Decoration) -> impl Iterator<Item = (Word, Word)> {
    module.annotations.iter().filter_map(move |instruction| match instruction.operands[..] {
        [Operand::IdRef(target), Operand::Decoration(decoration), Operand::LiteralBit32(value)]
            if instruction.class.opcode == Op::Decorate && decoration == wanted =>
        {
            Some((target, value))
        }
        _ => None,
    })
}

/// The compute entry points with their workgroup sizes.
fn entry_points(module: &Module) -> BTreeMap<String, EntryPoint> {
    let workgroup = |function| {
        let sizes = module.execution_modes.iter().find_map(|mode| local_size(mode, function));
        EntryPoint { workgroup: sizes.unwrap_or_default() }
    };
    let named = module.entry_points.iter().filter_map(|entry| match &entry.operands[..] {
        [_, Operand::IdRef(function), Operand::LiteralString(name), ..] => Some((name.clone(), *function)),
        _ => None,
    });
    named.map(|(name, function)| (name, workgroup(function))).collect()
}

/// The workgroup size, where `mode` states that of `function`.
fn local_size(mode: &Instruction, function: Word) -> Option<[Word; 3]> {
    match mode.operands[..] {
        [
            Operand::IdRef(target),
            Operand::ExecutionMode(ExecutionMode::LocalSize),
            Operand::LiteralBit32(x),
            Operand::LiteralBit32(y),
            Operand::LiteralBit32(z),
        ] if target == function => Some([x, y, z]),
        _ => None,
    }
}

/// The specialisation constants: the defaults of 32-bit integers by their ids.
fn spec_constants(module: &Module) -> BTreeMap<Word, Word> {
    let default_of = |id| {
        let constant = module.types_global_values.iter().find(|value| value.result_id == Some(id))?;
        match constant.operands[..] {
            [Operand::LiteralBit32(value)] if constant.class.opcode == Op::SpecConstant => Some(value),
            _ => None,
        }
    };
    decorated(module, Decoration::SpecId).filter_map(|(id, spec)| Some((spec, default_of(id)?))).collect()
}
