//! Building the tables and putting them on disk.

use std::path::{Path, PathBuf};

use omnilife_schemas::{records::ResultRecord, store};

use crate::{csv_table, error::LeaderboardError, markdown_table, ranking};

/// File name of the Markdown tables.
pub const MARKDOWN_FILE: &str = "table.md";

/// File name of the CSV table.
pub const CSV_FILE: &str = "table.csv";

/// The tables as written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tables {
    /// Content of [`MARKDOWN_FILE`].
    pub markdown: String,
    /// Content of [`CSV_FILE`].
    pub csv: String,
    /// Where the Markdown is.
    pub markdown_file: PathBuf,
    /// Where the CSV is.
    pub csv_file: PathBuf,
}

/// Builds the tables of some results, each with the file it came from, and writes them to the
/// folder `out`, which is made where it is missing.
///
/// Markdown holds one table per protocol, never a mixed one, in the layout of OmniLife360's
/// Table 2: PSNR and SSIM of input and novel views. CSV holds every metric. The same results give
/// the same bytes in whatever order they come.
///
/// # Errors
/// When there are no results, when two of them claim the same row or contradict each other, and
/// when a file cannot be written.
pub fn build(results: &[(PathBuf, ResultRecord)], out: &Path) -> Result<Tables, LeaderboardError> {
    if results.is_empty() {
        return Err(LeaderboardError::NoResults {
            folder: out.to_owned(),
        });
    }
    let groups = ranking::groups(results)?;
    let tables = Tables {
        markdown: markdown_table::render(&groups),
        csv: csv_table::render(&groups, &out.join(CSV_FILE))?,
        markdown_file: out.join(MARKDOWN_FILE),
        csv_file: out.join(CSV_FILE),
    };
    store::create_folder(out)?;
    store::write_bytes(&tables.markdown_file, tables.markdown.as_bytes())?;
    store::write_bytes(&tables.csv_file, tables.csv.as_bytes())?;
    Ok(tables)
}
