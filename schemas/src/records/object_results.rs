//! Scores of single objects in a result: means over frames, then over the objects of a class.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    result::{Direction, Summary},
    scene::ObjectClass,
};

/// Scores of the objects of a scene, where the protocol has metrics of single objects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectResults {
    /// CSV file of the values: view, frame, object, one column per metric.
    pub table: String,
    /// Every object of the scene for every kind of view that is scored, input views first.
    pub objects: Vec<ObjectResult>,
    /// Their classes.
    pub classes: Vec<ClassResult>,
}

/// Scores of one object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectResult {
    /// `input` or `novel`.
    pub view: String,
    /// Name of the object.
    pub object: String,
    /// Its class.
    pub class: ObjectClass,
    /// Scores by metric id, over the views that show the object. Empty where none does.
    pub scores: BTreeMap<String, Summary>,
}

/// Scores of the objects of a class.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ClassResult {
    /// `input` or `novel`.
    pub view: String,
    /// The class.
    pub class: ObjectClass,
    /// Scores by metric id. Empty where no object of the class has any.
    pub scores: BTreeMap<String, ClassSummary>,
}

/// A metric over the objects of a class, every object with the same weight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ClassSummary {
    /// Arithmetic mean of the objects' means over views.
    pub mean: f64,
    /// Arithmetic mean of the objects' standard deviations between views; `None` where no object has two views.
    pub standard_deviation: Option<f64>,
    /// Objects that have a mean, at least 1.
    pub objects: u32,
    /// Which of two scores is the better one.
    pub direction: Option<Direction>,
}

impl ObjectResults {
    /// Returns the scores of objects with those of their classes.
    pub fn new(table: String, objects: Vec<ObjectResult>) -> Self {
        let mut members: BTreeMap<(&str, ObjectClass), Vec<&ObjectResult>> = BTreeMap::new();
        for object in &objects {
            let class = (object.view.as_str(), object.class);
            members.entry(class).or_default().push(object);
        }
        let classes = members
            .into_iter()
            .map(|((view, class), members)| ClassResult {
                view: view.to_owned(),
                class,
                scores: of_class(&members),
            });
        Self {
            table,
            classes: classes.collect(),
            objects,
        }
    }

    /// Returns the score of a class by a metric, for a kind of view.
    pub fn of_class(&self, view: &str, class: ObjectClass, metric: &str) -> Option<&ClassSummary> {
        let mut classes = self.classes.iter();
        let found = classes.find(|found| found.view == view && found.class == class)?;
        found.scores.get(metric)
    }
}

fn of_class(members: &[&ObjectResult]) -> BTreeMap<String, ClassSummary> {
    let mut scores: BTreeMap<&String, Vec<&Summary>> = BTreeMap::new();
    for (metric, summary) in members.iter().flat_map(|object| &object.scores) {
        scores.entry(metric).or_default().push(summary);
    }
    let summary = |of_objects: &[&Summary]| -> Option<ClassSummary> {
        let means: Vec<f64> = of_objects.iter().map(|one| one.mean).collect();
        let deviations = of_objects.iter().filter_map(|one| one.standard_deviation);
        Some(ClassSummary {
            mean: mean(&means)?,
            standard_deviation: mean(&deviations.collect::<Vec<f64>>()),
            objects: means.len() as u32,
            direction: of_objects.first()?.direction,
        })
    };
    let scores = scores.into_iter();
    scores
        .filter_map(|(metric, of_objects)| Some((metric.clone(), summary(&of_objects)?)))
        .collect()
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(view: &str, name: &str, class: ObjectClass, psnr: &[f64]) -> ObjectResult {
        let summary = |mean: f64| Summary {
            mean,
            standard_deviation: (psnr.len() > 1).then_some(mean / 10.0),
            views: psnr.len() as u32,
            undefined_views: 0,
            direction: Some(Direction::HigherIsBetter),
        };
        let scores = mean(psnr).map(|mean| ("psnr-object".to_owned(), summary(mean)));
        ObjectResult {
            view: view.to_owned(),
            object: name.to_owned(),
            class,
            scores: scores.into_iter().collect(),
        }
    }

    #[test]
    fn classes_are_means_over_frames_and_then_over_objects() {
        let results = ObjectResults::new(
            "objects.csv".to_owned(),
            vec![
                // Three frames weigh as much as one.
                object("input", "car", ObjectClass::Vehicle, &[20.0, 30.0, 40.0]),
                object("input", "bus", ObjectClass::Vehicle, &[10.0]),
                object("input", "truck", ObjectClass::Vehicle, &[]),
                object("input", "walker", ObjectClass::Person, &[]),
                object("novel", "car", ObjectClass::Vehicle, &[50.0, 50.0]),
            ],
        );
        let vehicles = results.of_class("input", ObjectClass::Vehicle, "psnr-object");
        let expected = ClassSummary {
            mean: 20.0,
            standard_deviation: Some(3.0),
            objects: 2,
            direction: Some(Direction::HigherIsBetter),
        };
        assert_eq!(vehicles, Some(&expected));
        let people = results.of_class("input", ObjectClass::Person, "psnr-object");
        assert_eq!(people, None);
        let novel = results.of_class("novel", ObjectClass::Vehicle, "psnr-object");
        assert_eq!(novel.map(|summary| summary.mean), Some(50.0));
        assert_eq!((results.objects.len(), results.classes.len()), (5, 3));
    }
}
