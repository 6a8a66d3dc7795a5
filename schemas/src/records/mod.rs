//! JSON files that the crates exchange, one module per contract.
//!
//! Each type implements [`Record`]; its JSON Schema is generated into `schemas/json/` and a test
//! fails when the two drift apart.

pub mod about;
pub mod analysis;
pub mod annotation;
pub mod asset;
pub mod boundaries;
mod capture;
pub mod dataset;
pub mod dataset_status;
pub mod dense;
pub mod external_run;
pub mod frame_set;
pub mod georeference;
pub mod ledger;
pub mod lift;
pub mod masks;
pub mod object_results;
pub mod objects;
pub mod operator;
pub mod overlays;
pub mod pose_scores;
pub mod poses;
pub mod protocol;
pub mod result;
pub mod run;
pub mod scene;
pub mod scoring;
pub mod sequence;
pub mod sfm;
pub mod slices;
pub mod sphere_layout;
pub mod split;
pub mod stability;
pub mod submission;
pub mod sweep;
pub mod tracks;
pub mod worded_views;

pub use about::{About, Statements};
pub use analysis::VideoAnalysis;
pub use annotation::{
    Annotation, Caption, CaptionAnswer, Dynamics, EgoMotion, Measured, NameGroup, Tag, Taxonomy,
};
pub use asset::{
    Asset, AssetChanges, AssetLevel, AssetMoment, AssetMoments, AssetPage, AssetPlacement,
    AssetSource, AssetSplats, InvalidGaussians,
};
pub use boundaries::{Boundary, BoundaryKind, BoundaryLedger, RejectedShot};
pub use capture::Capture;
pub use dataset::{Dataset, InputFile, Origin, OriginKind, VideoEntry, VideoStatus};
pub use dataset_status::{
    DatasetStatus, LostVideo, PartState, PartStatus, SequencePart, SequenceStatus,
};
pub use dense::{DenseFrame, DenseStereo};
pub use external_run::{ExternalRun, Phase, PhaseName};
pub use frame_set::{FrameEntry, FrameSet, Sampling, SharpFrame, SharpFrames};
pub use georeference::{GeoFix, GeoPoint, GeoResiduals, Georeference, UtmPoint};
pub use ledger::{
    AuditDecision, AuditDecisions, Author, LedgerAction, LedgerEntry, PersonRole, SegmentLabel,
};
pub use lift::{Lift, LiftedView};
pub use masks::{MaskEntry, Masks};
pub use object_results::{ClassResult, ClassSummary, ObjectResult, ObjectResults};
pub use objects::{GraphObject, Objects};
pub use operator::{CapKind, Operator, OperatorCap, OperatorFinding, Pole};
pub use overlays::{Overlay, OverlayClass, OverlayReport, OverlaySpan, Sightings};
pub use pose_scores::{PoseAlignment, PoseAuc, PoseDrift, PoseScores, RelativePoseError};
pub use poses::{PosedFrame, Poses};
pub use protocol::{Colour, Padding, Protocol, Resampling, ScoredViews, SplitRule};
pub use result::{
    DIAGNOSIS_PREFIX, Direction, Failure, QUICK_LOOK, ResultRecord, RunStatement, ScoredFile,
    ScoredPredictions, ScoredRegions, StatedClock, Summary, TrainingKind, Unavailable,
    is_of_region,
};
pub use run::{
    Backend, ComponentDecision, Edits, PLANNING, RENDERING, RunRecord, StageTime, SurfaceFaults,
    TRAINING, TraceViews, ViewPredictions,
};
pub use scene::{
    DepthImage, DepthPrior, DistanceConvention, DistanceGrid, ObjectClass, PoseConvention,
    PoseSource, PoseValidation, PublishedSplit, Scale, Scene, SceneFrame, SceneObject,
    ValidationStatus,
};
pub use scoring::ScoringRecord;
pub use sequence::{
    Admission, CheckOutcome, DetectedProjection, Evidence, Probe, Sequence, SourceVideo,
    SphereTurn, SphericalMetadata, TimeRange, VideoProjection,
};
pub use sfm::{HeldOutScore, SfmAttempt, SfmReport};
pub use slices::{Segment, SegmentOutcome, SliceFile, SliceMethod, Slices};
pub use sphere_layout::{FaceOrder, FisheyeCircle, SphereLayout};
pub use split::{IncompleteGroup, Split, ViewGroup};
pub use stability::{
    StabilityMeasures, StabilityPoint, StabilityReport, StabilityRow, StabilityStatus,
    StabilitySweep,
};
pub use submission::{MethodCard, Submission, SubmittedFile, SubmittedResult, Verification};
pub use sweep::{RunnerLock, SweepPlan, SweepUnit, UnitInput, UnitNeeds, UnitOutcome, UnitRunner};
pub use tracks::{Detection, Track, TrackStage, Tracks};
pub use worded_views::{WordedView, WordedViews};

use std::path::Path;

use schemars::Schema;

use crate::{
    ownership::FileList,
    stage::{Done, StageStart},
    store::{self, Record, StoreError},
};

/// Name of a record type and its JSON Schema.
#[derive(Debug, Clone, Copy)]
pub struct SchemaEntry {
    /// `omnilife/<name>/<version>`.
    pub id: &'static str,
    /// Older versions that are read as this one.
    pub older: &'static [&'static str],
    /// Makes the JSON Schema.
    pub generate: fn() -> Schema,
    /// Reads a file as this record.
    pub check: fn(&Path) -> Result<(), StoreError>,
}

/// Reads a file as the record that its `schema` entry names.
///
/// # Errors
/// When the file is not a record, its schema is unknown, or it does not match its schema.
pub fn check_file(path: &Path) -> Result<(), StoreError> {
    let schema = store::schema_of(path)?;
    match SCHEMAS
        .iter()
        .find(|entry| entry.id == schema || entry.older.contains(&schema.as_str()))
    {
        Some(entry) => (entry.check)(path),
        None => Err(StoreError::malformed(
            path,
            format!("is of unknown schema {schema}"),
        )),
    }
}

/// All records of the workspace; tests walk them.
pub const SCHEMAS: &[SchemaEntry] = &[
    entry::<Dataset>(),
    entry::<DatasetStatus>(),
    entry::<About>(),
    entry::<VideoAnalysis>(),
    entry::<Sequence>(),
    entry::<Annotation>(),
    entry::<CaptionAnswer>(),
    entry::<Taxonomy>(),
    entry::<Masks>(),
    entry::<Operator>(),
    entry::<BoundaryLedger>(),
    entry::<LedgerEntry>(),
    entry::<AuditDecisions>(),
    entry::<Slices>(),
    entry::<Poses>(),
    entry::<SfmReport>(),
    entry::<Scene>(),
    entry::<DenseStereo>(),
    entry::<Tracks>(),
    entry::<Georeference>(),
    entry::<Objects>(),
    entry::<Protocol>(),
    entry::<Split>(),
    entry::<RunRecord>(),
    entry::<Lift>(),
    entry::<ExternalRun>(),
    entry::<WordedViews>(),
    entry::<Asset>(),
    entry::<ResultRecord>(),
    entry::<ScoringRecord>(),
    entry::<StabilityReport>(),
    entry::<PoseScores>(),
    entry::<Done>(),
    entry::<StageStart>(),
    entry::<FileList>(),
    entry::<SweepPlan>(),
    entry::<UnitOutcome>(),
    entry::<RunnerLock>(),
    entry::<Submission>(),
    entry::<Verification>(),
];

const fn entry<T: Record>() -> SchemaEntry {
    SchemaEntry {
        id: T::SCHEMA,
        older: T::OLDER,
        generate: generate::<T>,
        check: check::<T>,
    }
}

fn check<T: Record>(path: &Path) -> Result<(), StoreError> {
    store::read_record::<T>(path).map(drop)
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
