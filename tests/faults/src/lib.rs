//! A Vulkan layer that answers errors in place of the driver, so that whole programs meet them: the program that is
//! tested knows nothing of it, the Vulkan loader puts it between the program and the driver.
//!
//! A test makes [`Faults`], starts a program with their [environment](Faults::environment), and [plans](Faults::plan)
//! what is to fail, before or while the program runs.
#![cfg(target_os = "linux")]

mod layer;
mod plan;

pub use plan::Fault;

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

/// Where the layer finds the plan.
const PLAN: &str = "EMBOSS_FAULTS";
/// Where it notes what has failed, beside the plan.
const FAILED: &str = "failed";
const NAME: &str = "VK_LAYER_EMBOSS_faults";

/// The layer, for the programs that have its environment.
#[derive(Debug)]
pub struct Faults {
    folder: PathBuf,
}

impl Faults {
    /// Without a plan as yet: nothing fails. `folder` is an empty one, and has what the Vulkan loader reads.
    ///
    /// # Errors
    /// Where the folder takes no files.
    ///
    /// # Panics
    /// Where the layer was not built beside the test, as cargo builds it.
    pub fn new(folder: &Path) -> io::Result<Faults> {
        let file = format!("{DLL_PREFIX}emboss_faults{DLL_SUFFIX}");
        let library = std::env::current_exe()?.with_file_name(&file);
        assert!(library.is_file(), "{}: cargo builds the layer there", library.display());
        std::os::unix::fs::symlink(library, folder.join(&file))?;
        let manifest = format!(
            r#"{{
    "file_format_version": "1.2.0",
    "layer": {{
        "name": "{NAME}",
        "type": "GLOBAL",
        "library_path": "./{file}",
        "api_version": "1.3.0",
        "implementation_version": "1",
        "description": "Has devices fail"
    }}
}}
"#
        );
        std::fs::write(folder.join("faults.json"), manifest)?;
        Ok(Faults { folder: folder.to_owned() })
    }

    /// Variables that switch it on, below the validation layers: they see what a program does after an error.
    pub fn environment(&self) -> [(&'static str, OsString); 3] {
        [
            ("VK_ADD_LAYER_PATH", self.folder.clone().into()),
            ("VK_INSTANCE_LAYERS", format!("VK_LAYER_KHRONOS_validation:{NAME}").into()),
            (PLAN, self.folder.join("plan").into()),
        ]
    }

    /// The calls that have failed, in their order.
    ///
    /// # Errors
    /// Where there are none.
    pub fn failed(&self) -> io::Result<Vec<String>> {
        let text = std::fs::read_to_string(self.folder.join(FAILED))?;
        Ok(text.lines().map(str::to_owned).collect())
    }

    /// Has calls fail from now on. Calls are counted from here, or from the program's start where it starts later. A
    /// program has one plan.
    ///
    /// # Errors
    /// Where the folder takes no files.
    pub fn plan(&self, faults: &[Fault]) -> io::Result<()> {
        let lines: Vec<_> = faults.iter().map(Fault::to_string).collect();
        // What reads it reads all.
        let part = self.folder.join("part");
        std::fs::write(&part, lines.join("\n"))?;
        std::fs::rename(part, self.folder.join("plan"))
    }
}
