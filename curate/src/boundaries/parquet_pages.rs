//! Pages of a Parquet column whose headers are checked against their content, before a reader allocates by them.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use parquet::{
    column::page::{Page, PageMetadata, PageReader},
    errors::{ParquetError, Result},
};

/// Bytes of the smallest number that a dictionary holds.
const LEAST_BYTES: usize = 4;

/// Pages of a column of numbers, none of which states more values than it can hold.
pub(super) struct BoundedPages {
    pages: Box<dyn PageReader>,
    most_values: u32,
}

impl BoundedPages {
    /// Wraps `pages`; `most_values` limits a whole column, however it is encoded.
    pub(super) fn new(pages: Box<dyn PageReader>, most_values: u32) -> Self {
        Self { pages, most_values }
    }

    fn checked(&self, page: Page) -> Result<Page> {
        let (stated, most) = match &page {
            // Dictionaries hold their numbers one by one.
            Page::DictionaryPage {
                buf, num_values, ..
            } => (*num_values, buf.len() / LEAST_BYTES),
            Page::DataPage { num_values, .. } | Page::DataPageV2 { num_values, .. } => {
                (*num_values, self.most_values as usize)
            }
        };
        if stated as usize <= most {
            return Ok(page);
        }
        let reason = format!("a page states {stated} values, and {most} are possible in it");
        Err(ParquetError::General(reason))
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
