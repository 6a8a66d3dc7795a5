//! Compiled half of the Python package `omnilife`: readers, computations and scores.
//!
//! Images, masks and rays cross the border as bytes in C order, records as their JSON, so that the module is built
//! against no version of Python or `NumPy`. `python/omnilife` makes arrays and classes of them and checks shapes and
//! types first. Nothing is implemented twice: cameras are those of `omnilife_schemas`, metrics and scores those of
//! `omnilife_bench`, results are found as `omnilife_leaderboard` finds them.
//!
//! The module links neither FFmpeg nor OpenCV nor a GPU's libraries, because other packages in the same process bring
//! their own. The program `omnilife`, which is in the wheel too, does everything that needs them.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

use pyo3::pymodule;

mod background;
mod cameras;
mod errors;
mod images;
mod metrics;
mod records;
mod scoring;

#[pymodule]
mod _native {
    use std::panic;

    use omnilife_schemas::provenance;
    use pyo3::{Bound, PyResult, types::PyModule};

    #[pymodule_export]
    use crate::{
        cameras::{project, rays, resized, rotation_matrix, unproject},
        images::{read_distances, read_image, read_mask, read_points},
        metrics::{compute, metrics, scored_bytes},
        records::{protocols, query, read_record, results_below, scored_size},
        scoring::{score, split_scene},
    };

    /// Silences the panic hook: panics become exceptions, which report everything.
    #[pymodule_init]
    fn init(_module: &Bound<'_, PyModule>) -> PyResult<()> {
        panic::set_hook(Box::new(|_| ()));
        provenance::state_commit(env!("OMNILIFE_COMMIT"));
        Ok(())
    }
}
