//! What a SPIR-V module says of itself: its entry point's workgroup, specialisation constants, bindings.

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Decoration, ExecutionMode, Op, Word};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The interface of a SPIR-V module with one compute entry point, each list in ascending order.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct Contents {
    /// Threads of a workgroup along x, y and z.
    pub workgroup: [Word; 3],
    /// Default values of specialisation constants by id. Constants that the entry point does not read are absent.
    pub spec_constants: BTreeMap<Word, Word>,
    /// Bindings of descriptor set 0 that the entry point uses.
    pub bindings: BTreeSet<Word>,
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
    /// The module has another entry point than its name says, or several, or none.
    #[error("the module of {expected} has the entry points {found:?}")]
    EntryPoints {
        /// The only one that it should have.
        expected: String,
        /// What it has.
        found: Vec<String>,
    },
    /// A file of the folder could not be read, or the folder.
    #[error("{path}: {source}")]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system answered.
        source: std::io::Error,
    },
    /// Something else lies among the modules.
    #[error("{path} is not named as a SPIR-V module")]
    Stray {
        /// The file.
        path: PathBuf,
    },
}

/// The bytes of all modules in a folder, by the entry points that their names say.
pub fn read_all(folder: &Path) -> Result<BTreeMap<String, Vec<u8>>, ModuleError> {
    let at = |path: &Path| {
        let path = path.to_path_buf();
        |source| ModuleError::Read { path, source }
    };
    let mut modules = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(at(folder))? {
        let path = entry.map_err(at(folder))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let Some(entry_point) = name.strip_suffix(".spv") else {
            return Err(ModuleError::Stray { path });
        };
        modules.insert(entry_point.to_owned(), std::fs::read(&path).map_err(at(&path))?);
    }
    Ok(modules)
}

/// Parses a module.
pub fn parse(bytes: &[u8]) -> Result<Module, ModuleError> {
    rspirv::dr::load_bytes(bytes).map_err(|state| ModuleError::Malformed { reason: state.to_string() })
}

/// The interface of the module of an entry point.
pub fn contents(module: &Module, entry_point: &str) -> Result<Contents, ModuleError> {
    let function = match entry_points(module)[..] {
        [(name, function)] if name == entry_point => function,
        ref others => {
            let found = others.iter().map(|(name, _)| (*name).to_owned()).collect();
            return Err(ModuleError::EntryPoints { expected: entry_point.to_owned(), found });
        }
    };
    Ok(Contents {
        workgroup: workgroup(module, function),
        spec_constants: spec_constants(module),
        bindings: decorated(module, Decoration::Binding).map(|(_, binding)| binding).collect(),
    })
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

/// The names of the entry points, and their functions.
fn entry_points(module: &Module) -> Vec<(&str, Word)> {
    let named = module.entry_points.iter().filter_map(|entry| match &entry.operands[..] {
        [_, Operand::IdRef(function), Operand::LiteralString(name), ..] => Some((name.as_str(), *function)),
        _ => None,
    });
    named.collect()
}

/// The workgroup size of a function.
fn workgroup(module: &Module, function: Word) -> [Word; 3] {
    let sizes = module.execution_modes.iter().find_map(|mode| local_size(mode, function));
    sizes.unwrap_or_default()
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
