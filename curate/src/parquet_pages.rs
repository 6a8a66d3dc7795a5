//! Pages of a Parquet column whose headers are checked against their content, before a reader allocates by them.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    io,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use omnilife_schemas::{foreign_code::guarded, store::StoreError};
use parquet::{
    column::page::{Page, PageMetadata, PageReader},
    errors::{ParquetError, Result},
};

/// Bytes of the smallest value that a dictionary holds: a number, or the length of a text.
const LEAST_BYTES: usize = 4;

/// Runs code that reads a file as a table of `what`.
///
/// # Errors
/// When the file cannot be read, or is no such table.
pub(crate) fn reading<T>(
    path: &Path,
    what: &str,
    read: impl FnOnce() -> Result<T>,
) -> std::result::Result<T, StoreError> {
    let not_a_table = |reason: String| {
        StoreError::malformed(path, format!("not a Parquet table of {what}: {reason}"))
    };
    guarded(read)
        .map_err(not_a_table)?
        .map_err(|error| match error {
            // Machine faults, such as too many open files, are not faults of the file.
            ParquetError::External(source) => match source.downcast::<io::Error>() {
                Ok(source) => StoreError::read(path, *source),
                Err(other) => not_a_table(other.to_string()),
            },
            other => not_a_table(other.to_string()),
        })
}

/// Values that pages may still state. Clones share it.
#[derive(Debug, Clone)]
pub(crate) struct ValuesLeft(Arc<AtomicUsize>);

impl ValuesLeft {
    pub(crate) fn new(values: usize) -> Self {
        Self(Arc::new(AtomicUsize::new(values)))
    }

    /// Allows this many from now on.
    pub(crate) fn set(&self, values: usize) {
        self.0.store(values, Ordering::Relaxed);
    }

    /// Takes the values of a page; returns how many were left if they are too many.
    fn take(&self, values: usize) -> Result<(), usize> {
        let left = self.0.load(Ordering::Relaxed);
        self.set(left.checked_sub(values).ok_or(left)?);
        Ok(())
    }
}

/// Pages of a column, none of which states more values than it can hold.
pub(crate) struct BoundedPages {
    pages: Box<dyn PageReader>,
    left: ValuesLeft,
}

impl BoundedPages {
    /// Wraps `pages`; `left` limits all of them, however they are encoded.
    pub(crate) fn new(pages: Box<dyn PageReader>, left: ValuesLeft) -> Self {
        Self { pages, left }
    }

    fn checked(&self, page: Page) -> Result<Page> {
        let (stated, taken) = match &page {
            // Dictionaries hold their values one by one.
            Page::DictionaryPage {
                buf, num_values, ..
            } => {
                let most = buf.len() / LEAST_BYTES;
                let stated = *num_values as usize;
                (stated, if stated <= most { Ok(()) } else { Err(most) })
            }
            Page::DataPage { num_values, .. } | Page::DataPageV2 { num_values, .. } => {
                (*num_values as usize, self.left.take(*num_values as usize))
            }
        };
        taken.map(|()| page).map_err(|most| {
            ParquetError::General(format!(
                "a page states {stated} values, and {most} are possible in it"
            ))
        })
    }
}

impl Iterator for BoundedPages {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}

impl PageReader for BoundedPages {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        let page = self.pages.get_next_page()?;
        page.map(|page| self.checked(page)).transpose()
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        self.pages.peek_next_page()
    }

    fn skip_next_page(&mut self) -> Result<()> {
        self.pages.skip_next_page()
    }

    fn at_record_boundary(&mut self) -> Result<bool> {
        self.pages.at_record_boundary()
    }
}
