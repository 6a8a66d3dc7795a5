//! From rendered views and a manifest to scores.
//!
//! * [`protocols`]: rules of scoring; [`mod@split`]: frames that a method is given and frames that it predicts.
//! * [`metrics`]: definitions of scores, one file each; [`lpips`]: the networks of some.
//! * [`validate()`] and [`compare()`]: checks of predictions before scoring, and scores of two methods;
//! * [`external`]: an external method, run by its own commands; [`adapters`]: those of published ones;
//! * [`diagnosis`]: mistakes of convention in views, such as other axes, channels or encodings;
//! * [`curve`]: error against run time, from the traces of runs;
//! * [`stability_report`]: results of stiff and extreme cases, for people;
//! * [`tracking`]: tracks of vehicles against true ones; [`poses`]: camera poses against true ones;
//! * [`mod@video_consistency`]: temporal consistency of videos without a truth;
//! * [`scoring`]: folders of predictions against a scene's images, with every failure in the record.
//!
//! Predictions of any method are scored, so this crate knows no method and no renderer. Its metrics are separate from
//! every training loss: a bug in a loss must not hide in the score.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod adapters;
pub mod curve;
pub mod diagnosis;
pub mod error;
pub mod external;
pub mod lpips;
pub mod metrics;
pub mod poses;
pub mod protocols;
pub mod scoring;
pub mod split;
mod split_notes;
pub mod stability_report;
pub mod tracking;
pub mod video_consistency;

mod availability;
mod frames_table;
mod job;
mod loaded_view;
mod memory;
mod paired;
mod prediction;
mod run_facts;
mod scene_identity;
mod side_by_side;
mod statement;
mod summary;
mod truth;
mod validate;

pub use adapters::{ADAPTERS, Adapter, AdapterScenes, AdapterTrial, adapters_table, write_adapter};
pub use curve::{curves, curves_table};
pub use diagnosis::{Diagnosis, DiagnosisFinding, DiagnosisKind, diagnose};
pub use error::BenchError;
pub use external::{ExternalRequest, FailureRequest, record_failure, run_external};
pub use job::{DEFAULT_MEMORY_BYTES, MetricChoice, Predictions, ScoreRequest};
pub use metrics::{DepthPair, METRICS, Metric, Need, Sample, Undefined, ViewPair};
pub use paired::{Difference, PairedComparison, StoredResult, WinsAndLosses, compare};
pub use prediction::scored_bytes;
pub use protocols::{PROTOCOLS, ProtocolEntry};
pub use scoring::score;
pub use split::{split, split_scene, split_scene_under};
pub use split_notes::notes_on_split;
pub use stability_report::{stability_failures, stability_page, write_stability};
pub use statement::Statement;
pub use validate::{Finding, ValidationReport, unusable_views, validate};
