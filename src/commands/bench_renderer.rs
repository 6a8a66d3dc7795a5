//! `omnilife bench renderer`.

use std::path::Path;

use omnilife_reconstruct::step_cost::{CostRequest, measure, table::table};
use omnilife_schemas::{progress::Progress, store};

use crate::exit;

/// Measures one size after the other and prints the tables; a file has them too where one is asked for.
pub(crate) fn execute(
    requests: Vec<CostRequest>,
    out: Option<&Path>,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    progress.begin("renderer", Some(requests.len() as u64));
    let measured = requests.into_iter().map(|request| {
        let cost = measure(request);
        progress.advance(1);
        cost
    });
    let costs = measured.collect::<Result<Vec<_>, _>>();
    progress.end();
    let text = table(&costs?);
    if let Some(out) = out {
        store::write_bytes(out, text.as_bytes())?;
    }
    exit::print(&text)
}
