//! `omnilife bench stability`.

use std::path::Path;

use omnilife_bench::{stability_failures, stability_page, write_stability};
use omnilife_schemas::{ErrorKind, progress::Progress};
use omnilife_stability::devices::{Device, DeviceKind};

use crate::{
    cli::BackendArgument,
    exit::{self, BadRequest, PartialFailure},
};

/// Runs the catalogue, prints the page, and fails where a case fails. A requested backend that is missing is a bad
/// request; other missing backends are named in the report.
pub(crate) fn execute(
    out: Option<&Path>,
    backend: Option<BackendArgument>,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let kinds = match backend {
        None => DeviceKind::ALL.to_vec(),
        Some(BackendArgument::Cpu) => vec![DeviceKind::Cpu],
        Some(BackendArgument::Gpu) => {
            Device::open(DeviceKind::Gpu).map_err(BadRequest)?;
            vec![DeviceKind::Gpu]
        }
    };
    let mut report = omnilife_stability::run(&kinds, progress)?;
    if kinds.contains(&DeviceKind::Cpu) {
        report.rows.extend(omnilife_tracks::stability::rows());
    }
    if let Some(out) = out {
        write_stability(&report, out, progress)?;
    }
    exit::print(&stability_page(&report))?;
    let failed = stability_failures(&report);
    if failed.is_empty() {
        return Ok(());
    }
    Err(PartialFailure {
        message: format!("{} cases failed: {}", failed.len(), failed.join(", ")),
        blame: ErrorKind::Internal,
    }
    .into())
}
