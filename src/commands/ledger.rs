//! `omnilife curate ledger`.

use omnilife_curate::ledger::{
    self, Evidence, MergeRequest, agreement, candidates, resolve, resolve::MERGE_SECONDS,
};
use omnilife_schemas::{
    layout::LEDGER_FILE, lock::FolderLock, plain_text::counted, progress::Progress,
};

use super::curate::print_json;
use crate::{cli::LedgerCommand, exit};

pub(crate) fn execute(command: &LedgerCommand, progress: &dyn Progress) -> anyhow::Result<()> {
    match command {
        LedgerCommand::Merge {
            folder,
            files,
            author,
            role,
            time,
            reason,
        } => {
            let request = author.as_ref().map(|name| MergeRequest {
                author: role.author(name),
                time: time.clone(),
                reason: reason.clone(),
            });
            let _lock = FolderLock::take_existing(folder, progress)?;
            let merged = ledger::merge(folder, files, request.as_ref(), progress)?;
            exit::print(&format!(
                "{}: {}, boundaries that hold: {}\n",
                folder.join(LEDGER_FILE).display(),
                counted(merged.entries().len(), "line"),
                resolve(merged.entries()).len()
            ))
        }
        LedgerCommand::Show { folder } => {
            let ledger = Evidence::read(folder)?.ledger(folder)?;
            print_json(&candidates(ledger.entries(), MERGE_SECONDS))
        }
        LedgerCommand::Agreement { folder, tolerance } => {
            let ledger = Evidence::read(folder)?.ledger(folder)?;
            print_json(&agreement::of_ledger(&ledger, *tolerance))
        }
        LedgerCommand::Export { folder, format } => {
            let text = ledger::export(folder, format)?;
            exit::print(&text)
        }
    }
}
