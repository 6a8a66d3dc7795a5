//! `plan.json`: all units, written once and never changed.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_schemas::{
    records::{SweepPlan, SweepUnit},
    store,
};
use serde::Serialize;

use crate::error::SweepError;

/// Name of the plan in a sweep's folder.
pub const PLAN_FILE: &str = "plan.json";

/// Creates a plan of units and checks it. Units of the same id get numbers.
///
/// # Errors
/// When there are no units, or one has no commands, names no program or needs no core.
pub fn plan(
    folder: &Path,
    units: Vec<SweepUnit>,
    reduce: Vec<Vec<String>>,
) -> Result<SweepPlan, SweepError> {
    let units = with_unique_ids(units);
    let mut plan = SweepPlan {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        folder: folder.display().to_string(),
        units,
        reduce,
        sha256: String::new(),
    };
    plan.sha256 = hash(&plan);
    check(&plan).map_err(|reason| SweepError::Plan { reason })?;
    Ok(plan)
}

/// Writes a plan into a sweep's folder, where it stays.
///
/// # Errors
/// When the folder holds another plan already, or the file cannot be written.
pub fn write(folder: &Path, plan: &SweepPlan) -> Result<(), SweepError> {
    store::create_folder(folder)?;
    store::remove_abandoned(folder)?;
    let path = folder.join(PLAN_FILE);
    if path.exists() {
        let held = read(folder)?;
        return if held.sha256 == plan.sha256 {
            Ok(())
        } else {
            Err(SweepError::OtherPlan {
                path,
                reason: "holds another plan, and plans do not change; choose another folder"
                    .to_owned(),
            })
        };
    }
    Ok(store::write_record(&path, plan)?)
}

/// Reads the plan of a sweep's folder.
///
/// # Errors
/// When it cannot be read, or was changed.
pub fn read(folder: &Path) -> Result<SweepPlan, SweepError> {
    let path = folder.join(PLAN_FILE);
    let plan: SweepPlan = store::read_record(&path)?;
    let changed = |reason: String| SweepError::OtherPlan {
        path: path.clone(),
        reason,
    };
    if plan.sha256 != hash(&plan) {
        return Err(changed(
            "was changed after it was written; plan anew in another folder".to_owned(),
        ));
    }
    check(&plan).map_err(changed)?;
    Ok(plan)
}

/// Returns the SHA-256 of a unit as planned and the program's version: other commands, or another version, may give
/// another result.
pub fn unit_hash(unit: &SweepUnit) -> String {
    json_hash(&(env!("CARGO_PKG_VERSION"), unit))
}

fn hash(plan: &SweepPlan) -> String {
    json_hash(&(&plan.version, &plan.folder, &plan.units, &plan.reduce))
}

fn json_hash(value: &impl Serialize) -> String {
    // Plain structs of numbers and strings; a failure becomes part of the hash instead of being lost.
    let text = serde_json::to_string(value).unwrap_or_else(|error| error.to_string());
    store::sha256_bytes(text.as_bytes())
}

fn check(plan: &SweepPlan) -> Result<(), String> {
    if plan.units.is_empty() {
        return Err("a plan must have at least one unit, got none".to_owned());
    }
    let mut ids = BTreeSet::new();
    for unit in &plan.units {
        let id = &unit.id;
        if *id != file_name(id) {
            return Err(format!(
                "unit {id:?}: an id must be a valid name of a folder"
            ));
        }
        if !ids.insert(id) {
            return Err(format!("unit {id}: is planned twice"));
        }
        if unit.commands.is_empty() || unit.commands.iter().any(Vec::is_empty) {
            return Err(format!(
                "unit {id}: has no commands, or one without a program"
            ));
        }
        let limit = unit.needs.limit_seconds;
        if unit.needs.cores == 0 || limit.is_some_and(|limit| !(limit > 0.0 && limit.is_finite())) {
            return Err(format!(
                "unit {id}: needs at least one core, and a time limit above 0"
            ));
        }
    }
    Ok(())
}

fn with_unique_ids(mut units: Vec<SweepUnit>) -> Vec<SweepUnit> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    for unit in &mut units {
        let count = seen.entry(unit.id.clone()).or_default();
        *count = count.saturating_add(1);
        if *count > 1 {
            unit.id = format!("{}.{count}", unit.id);
        }
    }
    units
}

/// Returns a text as the name of a file: every character except letters, digits, `.`, `-` and `_` becomes `-`; at most
/// 100 characters, and never hidden.
pub fn file_name(text: &str) -> String {
    let kept: String = text
        .chars()
        .map(|character| match character {
            'a'..='z' | 'A'..='Z' | '0'..='9' | '.' | '-' | '_' => character,
            _ => '-',
        })
        .take(100)
        .collect();
    let kept = kept.trim_start_matches('.');
    if kept.is_empty() {
        "unit".to_owned()
    } else {
        kept.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::UnitNeeds;

    use super::*;

    fn unit(id: &str) -> SweepUnit {
        SweepUnit {
            id: id.to_owned(),
            group: "g".to_owned(),
            labels: BTreeMap::new(),
            commands: vec![vec!["true".to_owned()]],
            on_failure: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            needs: UnitNeeds {
                cores: 1,
                memory_bytes: 1,
                gpus: 0,
                limit_seconds: None,
            },
        }
    }

    #[test]
    fn names_are_safe_and_unique() -> Result<(), SweepError> {
        assert_eq!(file_name("../lake/seq 0"), "-lake-seq-0");
        assert_eq!(file_name("."), "unit");
        let made = plan(
            Path::new("/"),
            vec![unit("a"), unit("a"), unit("b")],
            vec![],
        )?;
        let ids: Vec<&str> = made.units.iter().map(|unit| unit.id.as_str()).collect();
        assert_eq!(ids, ["a", "a.2", "b"]);
        Ok(())
    }

    #[test]
    fn a_plan_does_not_change() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let first = plan(Path::new("/"), vec![unit("a")], vec![])?;
        write(folder.path(), &first)?;
        write(folder.path(), &first)?;
        let second = plan(Path::new("/"), vec![unit("b")], vec![])?;
        assert!(matches!(
            write(folder.path(), &second),
            Err(SweepError::OtherPlan { .. })
        ));
        let path = folder.path().join(PLAN_FILE);
        let text = std::fs::read_to_string(&path)?.replace("\"true\"", "\"false\"");
        std::fs::write(&path, text)?;
        let error = read(folder.path()).map(drop).expect_err("it was changed");
        assert!(error.to_string().contains("was changed"), "{error}");
        Ok(())
    }

    #[test]
    fn what_is_no_plan_is_refused() {
        let refused = |change: fn(&mut SweepUnit)| {
            let mut unit = unit("a");
            change(&mut unit);
            plan(Path::new("/"), vec![unit], vec![]).is_err()
        };
        assert!(!refused(|_| {}));
        assert!(refused(|unit| unit.commands.clear()));
        assert!(refused(|unit| unit.commands[0].clear()));
        assert!(refused(|unit| unit.needs.cores = 0));
        assert!(refused(|unit| unit.needs.limit_seconds = Some(f64::NAN)));
        assert!(refused(|unit| unit.id = "../a".to_owned()));
        assert!(plan(Path::new("/"), vec![], vec![]).is_err());
    }
}
