//! Tables of results, and queries on them.
//!
//! Four tidy tables, one row per value: [`RESULTS`] has the means of every result, [`VIEWS`] the scores of every view,
//! [`OBJECTS`] the means of single objects, [`CURVES`] the scores along a training. Their columns are listed in
//! [`columns`]. They are made of validated records, written as Parquet files beside a leaderboard, and queried by a
//! [`Query`].
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod columns;
mod curve;
mod error;
mod filter;
mod frame;
mod notes;
mod output;
mod parquet_file;
mod query;
mod rows;
mod scene_facts;
mod source;

pub use columns::{CURVES, OBJECTS, RESULTS, TABLES, Table, VIEWS, table};
pub use curve::{CurvePoint, left_out as curves_left_out, read as read_curve};
pub use error::ResultsError;
pub use filter::Filter;
pub use output::{AnswerFormat, render};
pub use parquet_file::{TableFile, write as write_table};
pub use query::{Answer, AnswerColumn, Query, Values, ask};
pub use scene_facts::{SceneFacts, read as read_scene_facts};
pub use source::{Source, scenes_of_other_regions};
