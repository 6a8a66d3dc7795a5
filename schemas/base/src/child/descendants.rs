//! Descendants of a program in Linux's list of processes.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use nix::{
    sys::wait::{WaitPidFlag, waitpid},
    unistd::Pid,
};

use super::tree::{Remnant, VARIABLE};
use crate::process::Stat;

/// Returns the running processes of the group that `leader` leads or led, their descendants, and orphans that carry
/// its mark with their descendants. `None` where the system does not list the processes that this one sees.
///
/// Orphans that have ended are reaped here, because their parents are gone. Programs for which this process waits by
/// itself are left alone: they stay in its session.
pub(super) fn look(leader: u32, mark: &str, known: &mut BTreeSet<u32>) -> Option<Vec<Remnant>> {
    let here = std::process::id();
    // This id differs where the list is that of another namespace.
    let listed = fs::read_link("/proc/self").ok()?;
    if listed != Path::new(&here.to_string()) {
        return None;
    }
    let all = processes();
    let session = all.get(&here)?.session;
    for (&id, stat) in &all {
        let is_orphan = stat.parent == here && id != leader && stat.has_ended;
        if is_orphan && (stat.group == leader || stat.session != session || known.contains(&id)) {
            wait_for(id);
        }
    }
    let members = members(&all, here, leader, mark);
    let running: Vec<Remnant> = all
        .iter()
        .filter(|&(id, stat)| !stat.has_ended && members.contains(id))
        .map(|(&id, stat)| Remnant {
            id,
            name: Some(stat.name.clone()),
        })
        .collect();
    let ids = running.iter().map(|remnant| remnant.id);
    known.extend(ids.filter(|&id| id != leader));
    Some(running)
}

fn processes() -> BTreeMap<u32, Stat> {
    let entries = fs::read_dir("/proc").into_iter().flatten();
    entries
        .filter_map(|entry| {
            let id: u32 = entry.ok()?.file_name().to_str()?.parse().ok()?;
            Some((id, Stat::of(id)?))
        })
        .collect()
}

fn members(all: &BTreeMap<u32, Stat>, here: u32, leader: u32, mark: &str) -> BTreeSet<u32> {
    let is_root = |id: u32, stat: &Stat| {
        let is_child = stat.parent == here && !stat.has_ended;
        stat.group == leader || (is_child && (id == leader || has_mark(id, mark)))
    };
    let mut members: BTreeSet<u32> = all
        .iter()
        .filter(|&(&id, stat)| is_root(id, stat))
        .map(|(&id, _)| id)
        .collect();
    loop {
        let children: Vec<u32> = all
            .iter()
            .filter(|&(id, stat)| !members.contains(id) && members.contains(&stat.parent))
            .map(|(&id, _)| id)
            .collect();
        if children.is_empty() {
            return members;
        }
        members.extend(children);
    }
}

/// Returns true for a process that was started with this mark; one that hides its variables is left alone.
fn has_mark(id: u32, mark: &str) -> bool {
    let variables = fs::read(format!("/proc/{id}/environ")).unwrap_or_default();
    let mut variables = variables.split(|&byte| byte == 0);
    variables.any(|variable| {
        let Some((name, marks)) = std::str::from_utf8(variable)
            .ok()
            .and_then(|variable| variable.split_once('='))
        else {
            return false;
        };
        name == VARIABLE && marks.split(':').any(|other| other == mark)
    })
}

fn wait_for(orphan: u32) {
    if let Ok(id) = i32::try_from(orphan) {
        // Another thread may have come first.
        let _ = waitpid(Pid::from_raw(id), Some(WaitPidFlag::WNOHANG));
    }
}
