//! From scores to tables and a site.
//!
//! [`build_leaderboard`] finds the `result.json` files of a folder and makes, separately for every protocol, tables in
//! the paper's layouts (Markdown, LaTeX, CSV) and a static site. Published figures ([`published`]) stand beside
//! measured ones and are never ranked with them. [`build`] makes only the table of all results; [`query`] answers
//! queries beyond the layouts, and [`datasets()`] lists datasets beside published ones. Images are copied for the site; only [`figure`] decodes them.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod aids;
mod assets;
mod budget;
mod class;
mod collect;
mod datasets;
mod description;
pub mod error;
pub mod figure;
mod format;
mod group;
mod layouts;
mod leaderboard;
mod numbers;
mod outputs;
pub mod published;
mod quantity;
mod questions;
mod readme;
mod remarks;
mod render;
mod repeats;
mod results_csv;
mod site;
pub mod submission;
mod table;
mod tables;
mod validate;
mod variants;

pub use collect::collect;
pub use datasets::{DatasetsFormat, datasets};
pub use description::{MethodDescription, OptionDescription};
pub use error::LeaderboardError;
pub use leaderboard::{
    Leaderboard, LeaderboardRequest, build_leaderboard, build_leaderboard_of, check_leaderboard,
};
pub use omnilife_results::{
    Answer, AnswerFormat, RESULTS, TABLES, Table, render, table as results_table,
};
pub use questions::{QueryRequest, query};
pub use site::is_web_address;
pub use tables::{CSV_FILE, MARKDOWN_FILE, Tables, build};
