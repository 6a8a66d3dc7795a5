//! `about`: description of a dataset by its makers.

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
    /// Description in a sentence or two.
    pub description: Option<String>,
    /// Further statements.
    pub statements: Option<Statements>,
}

impl Record for About {
    const SCHEMA: &'static str = "omnilife/about/1";
}

/// Statements that no record can give: those of responsible-AI metadata and of a datasheet.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Statements {
    /// Names of the makers.
    pub creators: Option<Vec<String>>,
    /// Address of the dataset.
    pub url: Option<String>,
    /// Version, as MAJOR.MINOR.PATCH.
    pub version: Option<String>,
    /// Date of publication, as YYYY-MM-DD.
    pub date_published: Option<String>,
    /// Citation, best as BibTeX.
    pub citation: Option<String>,
    /// Purpose that the dataset was made for.
    pub purpose: Option<String>,
    /// Funding of its making.
    pub funding: Option<String>,
    /// Limits of the data: conditions, places and uses that they do not cover.
    pub limitations: Option<String>,
    /// Known biases of the data.
    pub biases: Option<String>,
    /// Personal and sensitive information in the data: faces, number plates, places, voices.
    pub personal_information: Option<String>,
    /// True if a part of the data is rendered or generated.
    pub synthetic_data: Option<bool>,
    /// Sources of the footage: addresses or descriptions.
    pub sources: Option<Vec<String>>,
    /// Consent of the people who are seen, and of the owners of the footage.
    pub consent: Option<String>,
    /// Ethical review of the collection.
    pub ethical_review: Option<String>,
    /// Intended uses, and uses that the makers advise against.
    pub uses: Option<String>,
    /// Social impact: benefits, risks and their mitigation.
    pub social_impact: Option<String>,
    /// Maintenance: hosting, corrections, withdrawal, end of support.
    pub maintenance: Option<String>,
    /// Address for questions and requests for removal.
    pub contact: Option<String>,
}
