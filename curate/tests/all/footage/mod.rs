//! Results of curation on footage: projections, boundaries, overlays. The real clips are beside the checkout; each is
//! analysed once for all tests.

mod overlays;
mod projections;
mod real_clips;

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, OnceLock},
};

use omnilife_curate::{
    analysis::{Analysis, analyse},
    boundaries::DETECTORS,
};
use omnilife_schemas::progress::Silent;

use crate::support;

/// Analyses of real clips by name, each made by the first test that asks for it.
static ANALYSES: Mutex<BTreeMap<String, Arc<OnceLock<Analysis>>>> = Mutex::new(BTreeMap::new());

/// Calls `check` with the analysis of a real clip, where the clip is there.
fn of_real_clip(name: &str, check: impl FnOnce(&Analysis)) {
    let Some(path) = support::shared_data(name) else {
        return;
    };
    let slot = Arc::clone(ANALYSES.lock().unwrap().entry(name.to_owned()).or_default());
    check(slot.get_or_init(|| analyse(&path, &DETECTORS[0], None, &Silent).unwrap()));
}
