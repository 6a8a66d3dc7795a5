//! Metrics of a job and what they need.

use std::collections::BTreeSet;

use omnilife_schemas::object_regions::Region;

use super::ScoringJob;
use crate::metrics::{Metric, Need};

impl ScoringJob {
    /// Returns true if any computed metric has this need.
    pub(crate) fn needs(&self, need: Need) -> bool {
        self.computed().any(|metric| metric.needs.contains(&need))
    }

    /// Returns the classes whose masks computed metrics need.
    pub(crate) fn classes(&self) -> BTreeSet<&'static str> {
        let needs = self.computed().flat_map(|metric| metric.needs);
        let classes = needs.filter_map(|need| match need {
            Need::ClassMask(class) => Some(*class),
            _ => None,
        });
        classes.collect()
    }

    /// Returns the regions whose masks computed metrics need.
    pub(crate) fn regions_of_metrics(&self) -> Vec<Region<'static>> {
        let moving = self.needs(Need::DynamicMask).then_some(Region::Moving);
        let classes = self.classes().into_iter().map(Region::Class);
        moving.into_iter().chain(classes).collect()
    }

    /// Returns the available metrics of single objects.
    pub(crate) fn of_objects(&self) -> impl Iterator<Item = &'static Metric> {
        self.computed()
            .filter(|metric| metric.needs.contains(&Need::ObjectMasks))
    }

    pub(crate) fn computed(&self) -> impl Iterator<Item = &'static Metric> {
        let metrics = self.metrics.iter();
        metrics
            .filter(|metric| metric.unavailable.is_none())
            .map(|metric| metric.metric)
    }
}
