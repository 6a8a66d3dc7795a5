//! `about`: what its makers say of a dataset.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `about.json`, beside `dataset.json`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct About {
    /// Name of the dataset.
    pub name: String,
    /// Licence of the whole, as an SPDX identifier where there is one.
    pub licence: Option<String>,
    /// What it is, in a sentence or two.
    pub description: Option<String>,
}

impl Record for About {
    const SCHEMA: &'static str = "omnilife/about/1";
}
