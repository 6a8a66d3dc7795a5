//! `ledger.jsonl`: reading it with its chain of hashes, and appending to it.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::{
        AuditDecisions, Author, Boundary, LedgerAction, LedgerEntry, PersonRole, SourceVideo,
        TimeRange,
    },
    store::{self, Record, StoreError},
};

use super::check;
use crate::error::CurateError;

/// An author's addition to a ledger: a [`LedgerEntry`] without the fields that the ledger fills in.
#[derive(Debug, Clone, PartialEq)]
pub struct Statement {
    /// Author.
    pub author: Author,
    /// Time (RFC 3339), for people.
    pub time: Option<String>,
    /// Reason.
    pub reason: Option<String>,
    /// Action.
    pub action: LedgerAction,
}

/// The ledger of one video.
#[derive(Debug, Clone, PartialEq)]
pub struct Ledger {
    path: PathBuf,
    /// The file's lines, without line breaks.
    lines: Vec<String>,
    entries: Vec<LedgerEntry>,
    source: SourceVideo,
    range: TimeRange,
}

impl Ledger {
    /// Starts a ledger in memory, until [`Ledger::write`].
    ///
    /// # Errors
    /// When its first line cannot be serialized.
    pub fn open_new(
        path: &Path,
        source: SourceVideo,
        range: TimeRange,
    ) -> Result<Self, CurateError> {
        let mut ledger = Self {
            path: path.to_owned(),
            lines: Vec::new(),
            entries: Vec::new(),
            source: source.clone(),
            range,
        };
        ledger.push(Statement {
            author: Author::Detector("omnilife".to_owned()),
            time: None,
            reason: None,
            action: LedgerAction::Open { source, range },
        })?;
        Ok(ledger)
    }

    /// Reads a ledger and checks it: schema and chain of every line, boundaries inside the video, decisions about lines
    /// with a proposal.
    ///
    /// # Errors
    /// [`CurateError::Store`] that names the line.
    pub fn read(path: &Path) -> Result<Self, CurateError> {
        let text = fs::read_to_string(path).map_err(|source| StoreError::read(path, source))?;
        let malformed = |line: usize, reason: &str| {
            StoreError::malformed(path, format!("line {}: {reason}", line + 1))
        };
        let mut ledger: Option<Self> = None;
        let mut previous = String::new();
        for (number, line) in text.lines().enumerate() {
            let value: serde_json::Value = serde_json::from_str(line)
                .map_err(|error| malformed(number, &format!("not JSON: {error}")))?;
            if value["schema"] != LedgerEntry::SCHEMA {
                return Err(malformed(number, &format!("is not {}", LedgerEntry::SCHEMA)).into());
            }
            let entry: LedgerEntry = serde_json::from_value(value)
                .map_err(|error| malformed(number, &error.to_string()))?;
            if entry.id != number as u64 || entry.previous_sha256 != previous {
                return Err(malformed(
                    number,
                    "does not follow from the line before: an earlier line was changed, added or \
                     removed",
                )
                .into());
            }
            previous = store::sha256_bytes(line.as_bytes());
            let ledger = match (&mut ledger, &entry.action) {
                (None, LedgerAction::Open { source, range }) => ledger.insert(Self {
                    path: path.to_owned(),
                    lines: Vec::new(),
                    entries: Vec::new(),
                    source: source.clone(),
                    range: *range,
                }),
                (None, _) => return Err(malformed(0, "does not open a ledger").into()),
                (Some(ledger), action) => {
                    ledger
                        .check(action)
                        .map_err(|reason| malformed(number, &reason))?;
                    ledger
                }
            };
            ledger.lines.push(line.to_owned());
            ledger.entries.push(entry);
        }
        ledger.ok_or_else(|| StoreError::malformed(path, "is empty").into())
    }

    /// Returns all lines.
    pub fn entries(&self) -> &[LedgerEntry] {
        &self.entries
    }

    /// Returns the video.
    pub fn source(&self) -> &SourceVideo {
        &self.source
    }

    /// Returns the video's whole time range.
    pub fn range(&self) -> TimeRange {
        self.range
    }

    /// Appends the boundaries of one author, in order of time, without the author's existing proposals. Returns the
    /// number of new lines.
    ///
    /// # Errors
    /// [`CurateError::Input`] when one lies outside the video or two overlap; then nothing is appended.
    pub fn propose(
        &mut self,
        author: &Author,
        time: Option<&str>,
        reason: Option<&str>,
        boundaries: Vec<Boundary>,
    ) -> Result<usize, CurateError> {
        let boundaries = check::boundaries(boundaries, self.range)
            .map_err(|reason| CurateError::input(&self.path, reason))?;
        let known: Vec<Boundary> = self.proposals_of(author).cloned().collect();
        let mut added = 0;
        for boundary in boundaries {
            if known.contains(&boundary) {
                continue;
            }
            self.append(Statement {
                author: author.clone(),
                time: time.map(ToOwned::to_owned),
                reason: reason.map(ToOwned::to_owned),
                action: LedgerAction::Propose(boundary),
            })?;
            added += 1;
        }
        Ok(added)
    }

    /// Appends the decisions of an audit page, without those that hold already. Returns the number of new lines.
    ///
    /// # Errors
    /// [`CurateError::Input`] when the decisions concern another video or lines without a proposal, or an annotator
    /// decides on proposals of others; then nothing is appended.
    pub fn decide(&mut self, audit: &AuditDecisions) -> Result<usize, CurateError> {
        if audit.source_sha256 != self.source.sha256 {
            return Err(CurateError::input(
                &self.path,
                format!(
                    "the decisions are about another video (sha256 {:.12})",
                    audit.source_sha256
                ),
            ));
        }
        let name = audit.author.clone();
        let author = match audit.role {
            PersonRole::Annotator => Author::Annotator(name),
            PersonRole::Expert => Author::Expert(name),
        };
        let mut extended = self.clone();
        let mut added = 0;
        for decision in &audit.decisions {
            let is_own = matches!(
                decision.action,
                LedgerAction::Propose(_) | LedgerAction::Label(_)
            );
            if audit.role == PersonRole::Annotator && !is_own {
                return Err(CurateError::input(
                    &self.path,
                    "an annotator cannot accept, reject or move what others proposed",
                ));
            }
            let statement = Statement {
                author: author.clone(),
                time: Some(decision.time.clone()),
                reason: decision.reason.clone(),
                action: decision.action.clone(),
            };
            let stands = self.entries.iter().any(|entry| {
                entry.author == statement.author
                    && entry.time == statement.time
                    && entry.action == statement.action
            });
            if !stands {
                extended.append(statement)?;
                added += 1;
            }
        }
        *self = extended;
        Ok(added)
    }

    /// Appends one line.
    ///
    /// # Errors
    /// [`CurateError::Input`] when it is invalid as the next line.
    pub fn append(&mut self, statement: Statement) -> Result<(), CurateError> {
        self.check(&statement.action)
            .map_err(|reason| CurateError::input(&self.path, reason))?;
        self.push(statement)
    }

    /// Returns the boundaries that an author proposed.
    pub fn proposals_of<'a>(&'a self, author: &'a Author) -> impl Iterator<Item = &'a Boundary> {
        self.entries
            .iter()
            .filter_map(move |entry| match &entry.action {
                LedgerAction::Propose(boundary) if entry.author == *author => Some(boundary),
                _ => None,
            })
    }

    /// Returns the SHA-256 of the whole file.
    pub fn sha256(&self) -> String {
        store::sha256_bytes(self.text().as_bytes())
    }

    /// Writes the ledger atomically.
    ///
    /// # Errors
    /// [`CurateError::Input`] when the file on disk does not start with this ledger's lines: another process has
    /// appended.
    pub fn write(&self) -> Result<(), CurateError> {
        let text = self.text();
        match fs::read_to_string(&self.path) {
            Ok(held) if !text.starts_with(&held) => {
                return Err(CurateError::input(
                    &self.path,
                    "has changed since it was read; nothing was written, run the command again",
                ));
            }
            _ => {}
        }
        Ok(store::write_bytes(&self.path, text.as_bytes())?)
    }

    fn text(&self) -> String {
        self.lines.iter().map(|line| format!("{line}\n")).collect()
    }

    /// Checks that an action is valid as the next line.
    fn check(&self, action: &LedgerAction) -> Result<(), String> {
        let proposed = |id: u64| {
            let entry = usize::try_from(id).ok().and_then(|id| self.entries.get(id));
            match entry.map(|entry| &entry.action) {
                Some(LedgerAction::Propose(_)) => Ok(()),
                _ => Err(format!(
                    "line {id} proposed no boundary that could be decided on"
                )),
            }
        };
        match action {
            LedgerAction::Open { .. } => Err("a ledger is opened once".to_owned()),
            LedgerAction::Propose(boundary) => check::boundary(boundary, self.range),
            LedgerAction::Accept(id) | LedgerAction::Reject(id) => proposed(*id),
            LedgerAction::Move { id, boundary } => {
                proposed(*id)?;
                check::boundary(boundary, self.range)
            }
            LedgerAction::Label(label) => check::label(label, self.range),
        }
    }

    fn push(&mut self, statement: Statement) -> Result<(), CurateError> {
        let entry = LedgerEntry {
            id: self.entries.len() as u64,
            previous_sha256: self
                .lines
                .last()
                .map_or_else(String::new, |line| store::sha256_bytes(line.as_bytes())),
            author: statement.author,
            time: statement.time,
            reason: statement.reason,
            action: statement.action,
        };
        let line =
            store::record_line(&entry).map_err(|error| CurateError::internal(&self.path, error))?;
        self.lines.push(line);
        self.entries.push(entry);
        Ok(())
    }
}
