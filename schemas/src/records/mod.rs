//! The JSON files that the crates hand to each other, one file per contract.
//!
//! Each type implements [`Record`]; its JSON Schema is generated into `schemas/json/` and a test
//! fails when the two drift apart.

pub mod analysis;
pub mod boundaries;
pub mod dataset;
pub mod ledger;
pub mod poses;
pub mod protocol;
pub mod result;
pub mod run;
pub mod scene;
pub mod sequence;
pub mod sfm;
pub mod split;

pub use analysis::VideoAnalysis;
pub use boundaries::{Boundary, BoundaryKind, BoundaryLedger};
pub use dataset::{Dataset, VideoEntry, VideoStatus};
pub use ledger::{AuditDecision, AuditDecisions, Author, LedgerAction, LedgerEntry};
pub use poses::{PosedFrame, Poses};
pub use protocol::{Protocol, Resampling, SplitRule};
pub use result::{Direction, Failure, ResultRecord, Summary};
pub use run::{Backend, ComponentDecision, RunRecord, ViewPredictions};
pub use scene::{PoseSource, PoseValidation, Scale, Scene, SceneFrame, ValidationStatus};
pub use sequence::{
    Admission, CheckOutcome, ErpVerdict, Evidence, FrameEntry, FrameSet, Probe, Sampling, Sequence,
    SourceVideo, SphericalMetadata, TimeRange, Verdict,
};
pub use sfm::{SfmAttempt, SfmReport};
pub use split::Split;

use schemars::Schema;

use crate::{stage::Done, store::Record};

/// A record type's name and its JSON Schema.
#[derive(Debug, Clone, Copy)]
pub struct SchemaEntry {
    /// `omnilife/<name>/<version>`.
    pub id: &'static str,
    /// Makes the JSON Schema.
    pub generate: fn() -> Schema,
}

/// Every record of the workspace; tests walk it.
pub const SCHEMAS: &[SchemaEntry] = &[
    entry::<Dataset>(),
    entry::<VideoAnalysis>(),
    entry::<Sequence>(),
    entry::<BoundaryLedger>(),
    entry::<LedgerEntry>(),
    entry::<AuditDecisions>(),
    entry::<Poses>(),
    entry::<SfmReport>(),
    entry::<Scene>(),
    entry::<Protocol>(),
    entry::<Split>(),
    entry::<RunRecord>(),
    entry::<ResultRecord>(),
    entry::<Done>(),
];

const fn entry<T: Record>() -> SchemaEntry {
    SchemaEntry {
        id: T::SCHEMA,
        generate: generate::<T>,
    }
}

fn generate<T: Record>() -> Schema {
    let mut schema = schemars::schema_for!(T);
    if let Some(properties) = schema
        .get_mut("properties")
        .and_then(serde_json::Value::as_object_mut)
    {
        properties.insert(
            "schema".to_owned(),
            serde_json::json!({ "const": T::SCHEMA, "description": "Name and version of this contract" }),
        );
    }
    if let Some(required) = schema
        .get_mut("required")
        .and_then(serde_json::Value::as_array_mut)
    {
        required.insert(0, "schema".into());
    }
    schema
}
