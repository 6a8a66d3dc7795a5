//! Statements of the makers of a dataset that no record can give, and the places where they appear.

use std::{collections::BTreeSet, path::Path};

use omnilife_schemas::records::{About, Dataset, OriginKind, VideoStatus};
use serde_json::{Map, Value};

use crate::error::CurateError;

/// Answers by the key of their question; unanswered ones are not in it.
pub(super) type Answers = Map<String, Value>;

pub(super) struct Question {
    /// Entry of `about.json`, at its top or among its statements.
    pub(super) key: &'static str,
    pub(super) section: &'static str,
    /// Property in `croissant.json`.
    pub(super) property: Option<&'static str>,
    /// The question as the datasheet shows it.
    pub(super) text: &'static str,
}

/// Sections of a datasheet, in its order (Gebru et al., *Datasheets for Datasets*).
pub(super) const SECTIONS: [&str; 7] = [
    "Motivation",
    "Composition",
    "Collection process",
    "Preprocessing, cleaning, labelling",
    "Uses",
    "Distribution",
    "Maintenance",
];

const fn question(
    key: &'static str,
    section: usize,
    property: Option<&'static str>,
    text: &'static str,
) -> Question {
    let section = SECTIONS[section];
    Question {
        key,
        section,
        property,
        text,
    }
}

/// All questions. Those with a property are the required ones of Croissant 1.1 and of its responsible-AI extension, as
/// far as conferences ask for them (<https://neurips.cc/Conferences/2026/EvaluationsDatasetsHosting>).
pub(super) const QUESTIONS: &[Question] = &[
    question(
        "purpose",
        0,
        None,
        "For what purpose was the dataset created?",
    ),
    question("creators", 0, Some("creator"), "Who created it?"),
    question("funding", 0, None, "Who funded its creation?"),
    question(
        "description",
        1,
        Some("description"),
        "What do the instances represent?",
    ),
    question(
        "limitations",
        1,
        Some("rai:dataLimitations"),
        "Which conditions, places and uses does it not cover?",
    ),
    question(
        "biases",
        1,
        Some("rai:dataBiases"),
        "Which biases are known?",
    ),
    question(
        "personal_information",
        1,
        Some("rai:personalSensitiveInformation"),
        "Which personal or sensitive information does it contain?",
    ),
    question(
        "synthetic_data",
        1,
        Some("rai:hasSyntheticData"),
        "Is a part of it rendered or generated?",
    ),
    question(
        "sources",
        2,
        Some("prov:wasDerivedFrom"),
        "Where does the footage come from?",
    ),
    question(
        "consent",
        2,
        None,
        "Did people who are seen, and owners, consent?",
    ),
    question(
        "ethical_review",
        2,
        None,
        "Was the collection reviewed ethically?",
    ),
    question(
        "uses",
        4,
        Some("rai:dataUseCases"),
        "For which uses is it meant, and for which not?",
    ),
    question(
        "social_impact",
        4,
        Some("rai:dataSocialImpact"),
        "Which benefits and risks can its use have, and what limits the risks?",
    ),
    question(
        "licence",
        5,
        Some("license"),
        "Under which licence is it distributed?",
    ),
    question("url", 5, Some("url"), "Where is it distributed?"),
    question(
        "date_published",
        5,
        Some("datePublished"),
        "When was it published?",
    ),
    question("citation", 5, Some("citeAs"), "How is it cited?"),
    question("version", 6, Some("version"), "Which version is this?"),
    question(
        "contact",
        6,
        None,
        "Who answers questions and requests for removal?",
    ),
    question(
        "maintenance",
        6,
        Some("rai:dataReleaseMaintenancePlan"),
        "Who hosts, corrects and maintains it, and for how long?",
    ),
];

/// Returns what the makers state, and the sources where the record of the dataset gives all of them.
///
/// # Errors
/// [`CurateError::Internal`] when the statements cannot be converted.
pub(super) fn answers(about: &About, dataset: &Dataset) -> Result<Answers, CurateError> {
    let failed = |error| CurateError::internal(Path::new(&about.name), error);
    let mut answers = Answers::new();
    let statements = serde_json::to_value(&about.statements).map_err(failed)?;
    for value in [serde_json::to_value(about).map_err(failed)?, statements] {
        if let Value::Object(entries) = value {
            answers.extend(entries);
        }
    }
    answers.retain(|_, answer| match answer {
        Value::String(text) => !text.trim().is_empty(),
        Value::Array(texts) => !texts.is_empty(),
        other => other.is_boolean(),
    });
    if let (false, Some(sources)) = (answers.contains_key("sources"), sources(dataset)) {
        answers.insert("sources".to_owned(), sources.into_iter().collect());
    }
    Ok(answers)
}

/// Returns where the curated videos come from; `None` if that of any is not recorded.
fn sources(dataset: &Dataset) -> Option<BTreeSet<String>> {
    let videos = dataset.videos.iter();
    let curated = videos.filter(|video| matches!(video.status, VideoStatus::Curated { .. }));
    let sources = curated.map(|video| {
        let origin = video.origin.as_ref()?;
        let own = (origin.kind == Some(OriginKind::OwnCapture)).then(|| "own capture".to_owned());
        origin.url.clone().or(own)
    });
    let sources: BTreeSet<String> = sources.collect::<Option<_>>()?;
    (!sources.is_empty()).then_some(sources)
}

/// Returns the keys of the questions without an answer.
pub(super) fn unstated(answers: &Answers) -> Vec<&'static str> {
    let keys = QUESTIONS.iter().map(|question| question.key);
    keys.filter(|key| !answers.contains_key(*key)).collect()
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::Statements;

    use super::*;

    #[test]
    fn every_statement_has_a_question_and_is_an_answer() {
        let text = || Some("said".to_owned());
        let about = About {
            name: "Streets".to_owned(),
            licence: text(),
            description: text(),
            statements: Some(Statements {
                creators: Some(vec!["Ada".to_owned()]),
                url: text(),
                version: text(),
                date_published: text(),
                citation: text(),
                purpose: text(),
                funding: text(),
                limitations: text(),
                biases: text(),
                personal_information: text(),
                synthetic_data: Some(false),
                sources: Some(vec!["own capture".to_owned()]),
                consent: text(),
                ethical_review: text(),
                uses: text(),
                social_impact: text(),
                maintenance: text(),
                contact: text(),
            }),
        };
        let dataset = Dataset {
            videos: Vec::new(),
            not_taken: Vec::new(),
        };
        let full = answers(&about, &dataset).expect("plain values");
        assert_eq!(unstated(&full), [""; 0]);
        // The name is always known.
        assert_eq!(full.len(), QUESTIONS.len() + 1);
        let none = answers(&About::default(), &dataset).expect("plain values");
        assert_eq!(unstated(&none).len(), QUESTIONS.len());
    }
}
