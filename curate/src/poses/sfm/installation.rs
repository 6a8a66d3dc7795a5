//! Finding the Python interpreter that has pycolmap.

use std::{
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use omnilife_schemas::store;

use crate::error::SfmError;

/// Environment variable for the Python interpreter that has pycolmap.
pub const PYTHON_VARIABLE: &str = "OMNILIFE_SFM_PYTHON";
/// First version whose EQUIRECTANGULAR camera works.
const LEAST_VERSION: (u32, u32) = (4, 1);

/// An interpreter with pycolmap.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SfmInstallation {
    /// The interpreter.
    pub python: PathBuf,
    /// Version of pycolmap.
    pub version: String,
}

/// Looks for an interpreter with pycolmap: `$OMNILIFE_SFM_PYTHON`, else the virtual environment of `scripts/setup
/// --sfm` in the data folder.
///
/// # Errors
/// [`SfmError::NotInstalled`] that names the missing part.
pub fn installation() -> Result<SfmInstallation, SfmError> {
    let python = interpreter().ok_or_else(|| SfmError::NotInstalled {
        reason: "neither OMNILIFE_DATA, XDG_DATA_HOME nor HOME is set".to_owned(),
    })?;
    installation_at(&python)
}

fn installation_at(python: &Path) -> Result<SfmInstallation, SfmError> {
    let not_installed = |reason: String| SfmError::NotInstalled { reason };
    let output = Command::new(python)
        .args(["-c", "import pycolmap; print(pycolmap.__version__)"])
        .stdin(Stdio::null())
        .output()
        .map_err(|error| not_installed(format!("{}: {error}", python.display())))?;
    if !output.status.success() {
        return Err(not_installed(format!(
            "{} has no pycolmap",
            python.display()
        )));
    }
    let version = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    let mut parts = version
        .split('.')
        .map_while(|part| part.parse::<u32>().ok());
    let found = (parts.next().unwrap_or(0), parts.next().unwrap_or(0));
    if found < LEAST_VERSION {
        return Err(not_installed(format!(
            "{} has pycolmap {version}, {}.{} or newer is needed",
            python.display(),
            LEAST_VERSION.0,
            LEAST_VERSION.1
        )));
    }
    Ok(SfmInstallation {
        python: python.to_owned(),
        version,
    })
}

fn interpreter() -> Option<PathBuf> {
    let named = std::env::var_os(PYTHON_VARIABLE).filter(|value| !value.is_empty());
    named
        .map(PathBuf::from)
        .or_else(|| store::data_folder().map(|data| data.join("sfm/bin/python")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_interpreter_names_the_command_that_installs_it() {
        let error = installation_at(Path::new("/nowhere/python"))
            .map(|_| ())
            .map_err(|e| e.to_string());
        let message = error.err().unwrap_or_default();
        assert!(message.contains("scripts/setup --sfm"), "{message}");
        assert!(
            message.contains("/nowhere/python") && !message.contains('\n'),
            "{message}"
        );
    }
}
