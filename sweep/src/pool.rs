//! Execution of a sweep's missing units on this machine, as many at once as its cores and memory allow.
//!
//! One thread waits for each running unit; the pool's own thread starts units and ends them if necessary. One pool at a
//! time runs a sweep. Tasks of Slurm run their own unit alone; a unit's own lock keeps them and a pool from doing one
//! twice.

use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, RecvTimeoutError, Sender},
    },
    thread::{self, Scope},
    time::{Duration, Instant},
};

use omnilife_schemas::{
    progress::Progress,
    records::{SweepUnit, UnitOutcome},
    store::{self, StoreError},
};

use crate::{
    error::SweepError,
    folder::{self, Finished, Sweep, UnitState},
    history::History,
    host,
    lock::{self, HeldLock, Holder},
    process::{EndReason, Running},
    status::{self, Status},
    unit::{self, AttemptEnd, Launch, MOST_LOST_RUNNERS},
};

/// Interval for polling: time limits, requests to end.
const TICK: Duration = Duration::from_millis(100);
/// Interval for checking units of other runners.
const LOOK_ELSEWHERE: Duration = Duration::from_secs(1);

/// Resources of the machine that a pool may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PoolLimits {
    /// CPU cores.
    pub cores: u32,
    /// Resident memory of all units together, bytes.
    pub memory_bytes: u64,
    /// GPUs.
    pub gpus: u32,
}

/// Input and options of a run.
pub struct RunRequest<'a> {
    /// The sweep's folder.
    pub folder: PathBuf,
    /// This program, under the name `omnilife` in units.
    pub program: PathBuf,
    /// Usable resources.
    pub limits: PoolLimits,
    /// Ids of the units to run; `None` stands for all, and locks the sweep.
    pub only: Option<BTreeSet<String>>,
    /// Time for units to write their checkpoints when the pool is asked to end.
    pub grace: Duration,
    /// True to wait for units of Slurm tasks, or of processes left by a killed runner, and to do them if they do not
    /// finish.
    pub wait: bool,
    /// True to assign GPUs to units. A cluster's engine does that itself.
    pub assign_gpus: bool,
    /// Set to end the pool.
    pub stop: &'a AtomicBool,
}

/// Summary of the requested units.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunSummary {
    /// Units that are done, by any runner.
    pub done: usize,
    /// Units that this pool has done.
    pub done_here: usize,
    /// Units that failed, by any runner, with their outcomes.
    pub failed: Vec<UnitOutcome>,
    /// Units that other runners work on.
    pub elsewhere: usize,
    /// Units that exceed the resources, with the reason.
    pub too_big: Vec<(String, String)>,
}

/// Runs the missing units. Returns when none remains that this pool could do.
///
/// # Errors
/// When the sweep cannot be read or written, [`SweepError::Busy`] when another pool runs it, and
/// [`SweepError::Interrupted`] when it was asked to end before all was done. Failed units are in the summary.
pub fn run(request: &RunRequest<'_>, progress: &dyn Progress) -> Result<RunSummary, SweepError> {
    let sweep = Sweep::open(&request.folder)?;
    if let Some(only) = &request.only {
        only.iter().try_for_each(|id| sweep.unit(id).map(drop))?;
    }
    let lock = match request.only {
        Some(_) => None,
        None => Some(lock_sweep(&sweep.folder)?),
    };
    let mut pool = Pool::new(&sweep, request)?;
    progress.begin("units", Some(pool.waiting.len() as u64));
    let outcome = pool.run(progress);
    progress.status("");
    progress.end();
    let table = match lock {
        Some(lock) => write_table(&sweep, &lock),
        None => Ok(()),
    };
    // The error of the units takes precedence over that of the table.
    outcome?;
    table?;
    Ok(pool.summary())
}

fn write_table(sweep: &Sweep, lock: &HeldLock) -> Result<(), SweepError> {
    let written = Status::of(sweep.clone()).and_then(|status| Ok(status.write_csv()?));
    lock.file.release()?;
    written
}

fn lock_sweep(folder: &Path) -> Result<HeldLock, SweepError> {
    if let Some(lock) = HeldLock::take(folder)? {
        return Ok(lock);
    }
    let by = match lock::holder(folder)? {
        Holder::Runner(runner) => host::described(&runner),
        Holder::Nobody | Holder::Lost(_) => "another process".to_owned(),
    };
    let folder = folder.to_owned();
    Err(SweepError::Busy { folder, by })
}

/// Running unit.
struct Active {
    running: Arc<Running>,
    deadline: Option<Instant>,
    reserved: Reservation,
}

/// Resources reserved for a unit.
#[derive(Debug, Clone, Default)]
struct Reservation {
    cores: u32,
    memory_bytes: u64,
    gpus: Vec<u32>,
}

enum Fit {
    Now,
    Later,
    Never(String),
}

struct Pool<'a> {
    sweep: &'a Sweep,
    request: &'a RunRequest<'a>,
    history: History,
    /// Indices of units.
    waiting: VecDeque<usize>,
    elsewhere: Vec<usize>,
    active: BTreeMap<usize, Active>,
    done: usize,
    done_here: usize,
    failed: Vec<UnitOutcome>,
    too_big: Vec<(String, String)>,
    interrupted: usize,
    /// Error that ends the pool.
    broken: Option<StoreError>,
}

/// Message from the thread of a unit, given by its index, to the pool.
enum Message {
    /// The commands have ended, so that others may start; the outcome is being written.
    Idle(usize),
    /// The unit has ended.
    Ended(usize, Result<AttemptEnd, StoreError>),
}

impl<'a> Pool<'a> {
    fn new(sweep: &'a Sweep, request: &'a RunRequest<'a>) -> Result<Self, SweepError> {
        let states = sweep.states()?;
        let mut pool = Self {
            sweep,
            request,
            history: History::of(sweep.plan.units.iter().zip(&states)),
            waiting: VecDeque::new(),
            elsewhere: Vec::new(),
            active: BTreeMap::new(),
            done: 0,
            done_here: 0,
            failed: Vec::new(),
            too_big: Vec::new(),
            interrupted: 0,
            broken: None,
        };
        for (index, state) in states.into_iter().enumerate() {
            let id = &sweep.plan.units[index].id;
            if request.only.as_ref().is_none_or(|only| only.contains(id)) {
                pool.sort_in(index, state)?;
            }
        }
        Ok(pool)
    }

    /// Sorts a unit by its state. A runner that was killed between writing an outcome and releasing the lock has left
    /// a void file.
    fn sort_in(&mut self, index: usize, state: UnitState) -> Result<(), StoreError> {
        if matches!(state, UnitState::Done(_) | UnitState::Failed(_)) {
            lock::clear(&self.sweep.unit_folder(self.unit(index)))?;
        }
        match state {
            UnitState::Done(_) => self.done += 1,
            UnitState::Failed(outcome) => self.failed.push(*outcome),
            UnitState::Running(_) => self.elsewhere.push(index),
            UnitState::Missing { .. } => self.waiting.push_back(index),
        }
        Ok(())
    }

    fn unit(&self, index: usize) -> &'a SweepUnit {
        &self.sweep.plan.units[index]
    }

    fn run(&mut self, progress: &dyn Progress) -> Result<(), SweepError> {
        let (sender, receiver) = mpsc::channel::<Message>();
        let mut looked = Instant::now();
        let mut asked_to_end: Option<Instant> = None;
        thread::scope(|scope| -> Result<(), SweepError> {
            loop {
                let ending = self.broken.is_some() || self.request.stop.load(Ordering::Relaxed);
                if ending {
                    let asked = *asked_to_end.get_or_insert_with(Instant::now);
                    self.end_all(asked.elapsed() > self.request.grace);
                } else if let Err(error) = self.begin_units(scope, &sender, progress) {
                    self.broken = Some(error);
                    continue;
                }
                if self.active.is_empty() && (ending || self.is_over()) {
                    return Ok(());
                }
                let id = |index: &usize| self.unit(*index).id.as_str();
                let ids: Vec<&str> = self.active.keys().take(3).map(id).collect();
                progress.status(&ids.join(", "));
                match receiver.recv_timeout(TICK) {
                    Ok(Message::Idle(index)) => self.set_free(index),
                    Ok(Message::Ended(index, ended)) => self.take_in(index, ended, progress),
                    Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
                }
                self.end_overdue();
                if looked.elapsed() > LOOK_ELSEWHERE && !self.elsewhere.is_empty() {
                    self.look_elsewhere()?;
                    looked = Instant::now();
                }
            }
        })?;
        if let Some(error) = self.broken.take() {
            return Err(error.into());
        }
        let left = self.interrupted + self.waiting.len();
        if asked_to_end.is_some() && left > 0 {
            return Err(SweepError::Interrupted);
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.waiting.is_empty() && (self.elsewhere.is_empty() || !self.request.wait)
    }

    fn summary(self) -> RunSummary {
        RunSummary {
            done: self.done,
            done_here: self.done_here,
            failed: self.failed,
            elsewhere: self.elsewhere.len(),
            too_big: self.too_big,
        }
    }

    /// Starts every unit that fits, in the order of the plan.
    fn begin_units<'scope>(
        &mut self,
        scope: &'scope Scope<'scope, '_>,
        sender: &Sender<Message>,
        progress: &dyn Progress,
    ) -> Result<(), StoreError>
    where
        'a: 'scope,
    {
        let mut position = 0;
        while position < self.waiting.len() && self.free_cores() > 0 {
            let index = self.waiting[position];
            match self.fit(self.unit(index)) {
                Fit::Later => position += 1,
                Fit::Never(reason) => {
                    self.waiting.remove(position);
                    let id = self.unit(index).id.clone();
                    progress.note(&format!("{id}: {reason}"));
                    self.too_big.push((id, reason));
                    progress.advance(1);
                }
                Fit::Now => {
                    self.waiting.remove(position);
                    match self.lock(index)? {
                        Some(lock) => self.begin(index, lock, scope, sender),
                        None => progress.advance(1),
                    }
                }
            }
        }
        Ok(())
    }

    fn free_cores(&self) -> u32 {
        let used = self.active.values().map(|active| active.reserved.cores);
        self.request.limits.cores.saturating_sub(used.sum())
    }

    fn fit(&self, unit: &SweepUnit) -> Fit {
        let limits = &self.request.limits;
        let needs = &unit.needs;
        if self.active.is_empty() {
            // Alone it needs no margin above the measured memory.
            let memory = self.history.measured_memory_bytes(unit);
            let memory = memory.unwrap_or(needs.memory_bytes);
            let missing = [
                ("cores", u64::from(needs.cores), u64::from(limits.cores)),
                ("bytes of memory", memory, limits.memory_bytes),
                ("GPUs", u64::from(needs.gpus), u64::from(limits.gpus)),
            ];
            let missing = missing.iter().find(|(_, needed, there)| needed > there);
            return match missing {
                None => Fit::Now,
                Some((what, needed, there)) => {
                    Fit::Never(format!("needs {needed} {what}, this pool has {there}"))
                }
            };
        }
        let used = |of: fn(&Reservation) -> u64| -> u64 {
            self.active
                .values()
                .map(|active| of(&active.reserved))
                .sum()
        };
        let memory = self.history.memory_bytes(unit);
        let fits = needs.cores <= self.free_cores()
            && memory.saturating_add(used(|of| of.memory_bytes)) <= limits.memory_bytes
            && u64::from(needs.gpus) + used(|of| of.gpus.len() as u64) <= u64::from(limits.gpus);
        if fits { Fit::Now } else { Fit::Later }
    }

    /// Locks a unit; returns `None` if this pool must no longer run it.
    fn lock(&mut self, index: usize) -> Result<Option<HeldLock>, StoreError> {
        let unit = self.unit(index);
        let folder = self.sweep.unit_folder(unit);
        store::create_folder(&folder)?;
        let before = lock::holder(&folder)?;
        let Some(lock) = HeldLock::take(&folder)? else {
            self.elsewhere.push(index);
            return Ok(None);
        };
        // Another runner may have finished it meanwhile and released the lock.
        if let Finished::As(state) = self.sweep.outcome(unit)? {
            lock.file.release()?;
            self.sort_in(index, state)?;
            return Ok(None);
        }
        if lock.lost_runners >= MOST_LOST_RUNNERS {
            let last = match &before {
                Holder::Lost(runner) => folder::lost_runner(runner.as_deref()),
                Holder::Nobody | Holder::Runner(_) => folder::lost_runner(None),
            };
            let outcome = unit::give_up(self.sweep, unit, &lock, &last)?;
            self.failed.push(outcome);
            return Ok(None);
        }
        Ok(Some(lock))
    }

    fn begin<'scope>(
        &mut self,
        index: usize,
        lock: HeldLock,
        scope: &'scope Scope<'scope, '_>,
        sender: &Sender<Message>,
    ) where
        'a: 'scope,
    {
        let unit = self.unit(index);
        let reserved = self.reserve(unit);
        let threads = unit.needs.cores.to_string();
        let mut variables: Vec<(String, String)> = ["RAYON_NUM_THREADS", "OMP_NUM_THREADS"]
            .map(|name| (name.to_owned(), threads.clone()))
            .into();
        if self.request.assign_gpus {
            let devices: Vec<String> = reserved.gpus.iter().map(u32::to_string).collect();
            variables.push(("CUDA_VISIBLE_DEVICES".to_owned(), devices.join(",")));
        }
        let active = Active {
            running: Arc::default(),
            deadline: (unit.needs.limit_seconds)
                .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
                .and_then(|limit| Instant::now().checked_add(limit)),
            reserved,
        };
        let running = Arc::clone(&active.running);
        let (sweep, program, stop) = (self.sweep, &self.request.program, self.request.stop);
        let sender = sender.clone();
        scope.spawn(move || {
            // The pool waits for every unit it has started, so that every message is received.
            let idle = || drop(sender.send(Message::Idle(index)));
            let launch = Launch { program, variables };
            let ended = unit::run(sweep, unit, &lock, launch, &running, stop, idle);
            drop(sender.send(Message::Ended(index, ended)));
        });
        self.active.insert(index, active);
    }

    fn reserve(&self, unit: &SweepUnit) -> Reservation {
        let taken: BTreeSet<u32> = (self.active.values())
            .flat_map(|active| active.reserved.gpus.iter().copied())
            .collect();
        Reservation {
            cores: unit.needs.cores,
            memory_bytes: self.history.memory_bytes(unit),
            gpus: (0..self.request.limits.gpus)
                .filter(|gpu| !taken.contains(gpu))
                .take(unit.needs.gpus as usize)
                .collect(),
        }
    }

    /// Releases a unit's resources for others; its lock is still held.
    fn set_free(&mut self, index: usize) {
        if let Some(active) = self.active.get_mut(&index) {
            active.reserved = Reservation::default();
        }
    }

    fn take_in(
        &mut self,
        index: usize,
        ended: Result<AttemptEnd, StoreError>,
        progress: &dyn Progress,
    ) {
        self.active.remove(&index);
        let unit = self.unit(index);
        match ended {
            Ok(AttemptEnd::Over(outcome)) => {
                progress.advance(1);
                self.history.add(&unit.group, &outcome);
                for what in &outcome.left_running {
                    progress.note(&format!("{}: left running: {what}", unit.id));
                }
                if outcome.failure.is_some() {
                    progress.note(&status::failure_line(&outcome, &self.failed));
                    self.failed.push(*outcome);
                } else {
                    self.done += 1;
                    self.done_here += 1;
                }
            }
            Ok(AttemptEnd::Interrupted) => self.interrupted += 1,
            Err(error) => self.broken = Some(error),
        }
    }

    fn end_all(&self, kill: bool) {
        for active in self.active.values() {
            if kill {
                active.running.kill();
            } else if active.running.reason().is_none() {
                active.running.end(EndReason::Stop);
            }
        }
    }

    fn end_overdue(&self) {
        for active in self.active.values() {
            let overdue = active.deadline.map(|deadline| deadline.elapsed());
            match overdue {
                Some(over) if over > self.request.grace => active.running.kill(),
                Some(over) if over > Duration::ZERO && active.running.reason().is_none() => {
                    active.running.end(EndReason::Limit);
                }
                _ => {}
            }
        }
    }

    fn look_elsewhere(&mut self) -> Result<(), SweepError> {
        for index in std::mem::take(&mut self.elsewhere) {
            let state = self.sweep.state(self.unit(index))?;
            self.sort_in(index, state)?;
        }
        Ok(())
    }
}
