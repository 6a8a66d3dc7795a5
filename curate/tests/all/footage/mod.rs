//! Results of curation on footage: projections, boundaries, overlays. The real clips are beside the checkout; each is
//! analysed once for all tests.

mod key_frame_prefilter;
mod overlays;
mod projections;
mod real_clips;

use std::{
    collections::BTreeMap,
    path::Path,
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

/// Applies `use_it` to the analysis of a real clip; `None` without the clip.
fn of_real_clip<T>(name: &str, use_it: impl FnOnce(&Path, &Analysis) -> T) -> Option<T> {
    let path = support::shared_data(name)?;
    let slot = Arc::clone(ANALYSES.lock().unwrap().entry(name.to_owned()).or_default());
    let analysis = slot.get_or_init(|| analyse(&path, &DETECTORS[0], None, &Silent).unwrap());
    Some(use_it(&path, analysis))
}
