//! `docs/published-inconsistencies.md`.

use super::{Finding, Paper};

/// The report on what holds and what does not, in Markdown.
pub fn inconsistencies_markdown(papers: &[Paper], findings: &[Finding]) -> String {
    let mut text = String::from(
        "# What does not add up in the published tables\n\n\
         The tables of the papers are data in `leaderboard/published/`. Whatever can be re-derived \
         from them is, by `cargo test -p omnilife-leaderboard --test published`, which also compares \
         this page with what it finds (`UPDATE_DOCS=1` writes it). Numbers are compared up to the \
         rounding of what is printed. Bold type is lost in the text versions of the papers, so that \
         claims are checked instead of bold numbers; underlines are there in one table.\n",
    );
    for paper in papers {
        let of_paper = |holds: bool| {
            findings
                .iter()
                .filter(move |finding| finding.paper == paper.id && finding.holds == holds)
        };
        text.push_str(&format!("\n## {}\n", paper.title));
        for (heading, holds) in [
            ("Does not hold, or cannot be re-derived", false),
            ("Holds", true),
        ] {
            if of_paper(holds).next().is_none() {
                continue;
            }
            text.push_str(&format!("\n### {heading}\n\n"));
            for finding in of_paper(holds) {
                text.push_str(&item(finding));
            }
        }
        for table in &paper.tables {
            for note in &table.notes {
                text.push_str(&format!(
                    "\nTable {}, transcription: {note}\n",
                    table.number
                ));
            }
        }
    }
    text
}

fn item(finding: &Finding) -> String {
    let quotes: String = finding
        .quotes
        .iter()
        .map(|quote| format!(" \"{quote}\""))
        .collect();
    let says = if quotes.is_empty() {
        String::new()
    } else {
        format!(" The paper:{quotes}.")
    };
    let says = says.replace(".\".", ".\"");
    format!("- **{}.** {}{says}\n", finding.place, finding.text)
}
