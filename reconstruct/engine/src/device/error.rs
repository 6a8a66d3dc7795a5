//! Errors of the GPU backend.

use omnilife_schemas::{Classified, ErrorKind};

/// Errors of the GPU backend; messages are one line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// No adapter was found, not even a software one.
    #[error(
        "there is no GPU: no Vulkan, Metal or DX12 driver answers (Mesa's \
         mesa-vulkan-drivers brings a software one); use the backend cpu"
    )]
    NoAdapter,
    /// The environment names unknown kernels.
    #[error("{variable} must be {values}, got '{value}'")]
    Choice {
        /// Name of the variable.
        variable: &'static str,
        /// Known values.
        values: String,
        /// Its value.
        value: String,
    },
    /// The adapter's limits are below those that the kernels need.
    #[error("the GPU {adapter} is too small: {what} needs {needed}, it offers {offered}")]
    TooSmall {
        /// Name of the adapter.
        adapter: String,
        /// The limit.
        what: String,
        /// Required value.
        needed: u64,
        /// Value of the adapter.
        offered: u64,
    },
    /// The adapter gave no device.
    #[error("the GPU {adapter} cannot be opened: {reason}")]
    Open {
        /// Name of the adapter.
        adapter: String,
        /// The driver's reason.
        reason: String,
    },
    /// The device is out of memory.
    #[error("the memory of the GPU {adapter} is used up ({what}, {bytes} bytes)")]
    OutOfMemory {
        /// Name of the adapter.
        adapter: String,
        /// Name of the allocation.
        what: String,
        /// Size of the allocation.
        bytes: u64,
    },
    /// The device went away: driver reset, unplugged, switched off.
    #[error("the GPU {adapter} was lost: {reason}")]
    Lost {
        /// Name of the adapter.
        adapter: String,
        /// The driver's reason.
        reason: String,
    },
    /// The driver or wgpu rejected a command.
    #[error("the GPU {adapter} failed: {reason}")]
    Failed {
        /// Name of the adapter.
        adapter: String,
        /// First line of wgpu's message.
        reason: String,
    },
}

impl Classified for GpuError {
    fn error_kind(&self) -> ErrorKind {
        match self {
            Self::NoAdapter | Self::Choice { .. } => ErrorKind::User,
            Self::TooSmall { .. }
            | Self::OutOfMemory { .. }
            | Self::Open { .. }
            | Self::Lost { .. }
            | Self::Failed { .. } => ErrorKind::Internal,
        }
    }
}
