//! Units of a benchmark, one per method, scene, seed and protocol: split, training, scores.
//!
//! ```text
//! RESULTS/<scene>/<protocol>/split.json
//! RESULTS/<scene>/<protocol>/<method>/seed-<n>/run/      what `reconstruct train` leaves
//! RESULTS/<scene>/<protocol>/<method>/seed-<n>/score/    result.json, of failures too
//! RESULTS/leaderboard/                                   tables and site of all of them
//! ```

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_bench::{
    external::{EXTERNAL_RUN_FILE, manifest::Manifest, own_files},
    protocols,
};
use omnilife_reconstruct::methods::{self, Method as OurMethod, variant::Variant};
use omnilife_schemas::{
    layout::{RUN_FILE, SCENE_FILE, SPLIT_FILE},
    records::{Scene, SweepUnit, UnitNeeds},
    store,
};
use omnilife_sweep::plan;

use super::{
    absolute, argument, left_out::LeftOut, needs, own_command, scoring, scoring_networks,
    tensorboard, words,
};
use crate::{
    cli::{AidsArgument, BenchPlanArguments, plan_word},
    exit::BadRequest,
};

/// Request for a benchmark: methods and scenes.
pub(crate) struct BenchmarkRequest<'a> {
    pub(crate) results: &'a Path,
    /// Scenes, or folders that are searched for them.
    pub(crate) scenes: &'a [PathBuf],
    pub(crate) methods: &'a [Method],
    pub(crate) protocols: &'a [String],
    /// Pairs of a scene and a protocol without units.
    pub(crate) left_out: &'a [LeftOut],
    /// Seeds; methods without training run once.
    pub(crate) seeds: &'a [u64],
    /// Options of `reconstruct train` for the methods that are trained.
    pub(crate) train: &'a [String],
    /// Folder of event files for TensorBoard, in a folder per unit.
    pub(crate) tensorboard: Option<&'a Path>,
    /// Share of the machine that a unit takes.
    pub(crate) needs: UnitNeeds,
}

/// Returns units that score one method each.
///
/// # Errors
/// When a scene or protocol is unknown, or the options are invalid.
pub(crate) fn units(request: &BenchmarkRequest<'_>) -> anyhow::Result<Vec<SweepUnit>> {
    let results = absolute(request.results)?;
    let scenes = scenes(request.scenes)?;
    for protocol in request.protocols {
        protocols::protocol(protocol)?;
    }
    refuse_unused(request.train, request.methods)?;
    // The use of tracks for the regions of a scene must not depend on which method came first.
    let requiring: Vec<&Method> = (request.methods.iter())
        .filter(|method| method.has_requirements())
        .collect();
    let networks = scoring_networks()?;
    let mut units = Vec::new();
    // A benchmark that is cut short has whole repetitions, not whole scenes.
    for (repetition, seed) in request.seeds.iter().enumerate() {
        for (id, file) in &scenes {
            for protocol in request.protocols {
                if (request.left_out.iter()).any(|left_out| left_out.is_of(id, protocol)) {
                    continue;
                }
                for method in request.methods {
                    if repetition > 0 && method.has_no_seed() {
                        continue;
                    }
                    let work = Work {
                        results: &results,
                        scene: (id, file),
                        protocol,
                        method,
                        requiring: &requiring,
                        seed: *seed,
                        train: request.train,
                        tensorboard: request.tensorboard,
                        networks: &networks,
                        needs: request.needs,
                    };
                    units.push(work.unit()?);
                }
            }
        }
    }
    Ok(units)
}

/// Returns the units of `sweep plan bench`, and the command that makes tables of their results.
///
/// # Errors
/// When a scene, method or protocol is unknown, or the options are invalid.
pub(crate) fn sweep(
    arguments: &BenchPlanArguments,
) -> anyhow::Result<(Vec<SweepUnit>, Vec<String>)> {
    let methods = methods(&arguments.methods)?;
    refuse_unused(&arguments.train, &methods)?;
    let (train, tensorboard) = without_tensorboard(&arguments.train);
    let units = units(&BenchmarkRequest {
        results: &arguments.results,
        scenes: &arguments.scenes,
        methods: &methods,
        protocols: &arguments.protocols,
        left_out: &[],
        seeds: &arguments.seeds,
        train: &train,
        tensorboard: tensorboard.as_deref(),
        needs: needs(&arguments.plan)?,
    })?;
    let results = absolute(&arguments.results)?;
    let board = argument(&results.join("leaderboard"))?;
    let reduce = words(&[
        "leaderboard",
        "build",
        &argument(&results)?,
        "--out",
        &board,
    ]);
    Ok((units, own_command(reduce)?))
}

fn refuse_unused(train: &[String], methods: &[Method]) -> anyhow::Result<()> {
    if train.is_empty() || methods.iter().any(Method::is_trained) {
        return Ok(());
    }
    let options = train.join(" ");
    let reason = format!("{options}: options of a training, and none of the methods is trained");
    Err(BadRequest(reason).into())
}

/// Takes the folder of `--tensorboard` out of options of a training, because every unit has one of its own below it. A
/// second such option or one without a folder stays, and is refused as the unit's own command line would refuse it.
fn without_tensorboard(train: &[String]) -> (Vec<String>, Option<PathBuf>) {
    const OPTION: &str = "--tensorboard";
    for (at, word) in train.iter().enumerate() {
        let (folder, behind) = match word.strip_prefix(OPTION) {
            Some("") => (train.get(at + 1).map(String::as_str), at + 2),
            Some(value) => (value.strip_prefix('='), at + 1),
            None => (None, at),
        };
        if let Some(folder) = folder.filter(|folder| !folder.is_empty()) {
            let others = train[..at].iter().chain(&train[behind..]);
            return (others.cloned().collect(), Some(folder.into()));
        }
    }
    (train.to_vec(), None)
}

/// Returns the methods of these names and method.toml files, each once: results are told apart by them.
///
/// # Errors
/// When one is unknown, invalid or given twice.
pub(crate) fn methods(names: &[String]) -> anyhow::Result<Vec<Method>> {
    let mut methods: Vec<Method> = Vec::new();
    for name in names {
        let method = Method::find(name)?;
        if methods.iter().any(|other| other.id == method.id) {
            return Err(BadRequest(format!("method {} is given twice", method.id)).into());
        }
        methods.push(method);
    }
    Ok(methods)
}

/// Returns the rows of methods with the chosen aids, each once. External methods have none.
///
/// # Errors
/// When a method does not exist.
pub(crate) fn with_aids(methods: Vec<Method>, aids: AidsArgument) -> anyhow::Result<Vec<Method>> {
    let mut rows: Vec<Method> = Vec::new();
    for method in methods {
        let (bare, aided) = match &method.kind {
            MethodKind::Ours(_, variant) => (variant.bare()?, variant.aided()?),
            MethodKind::External(_) => (None, None),
        };
        let (keeps_own, other) = match aids {
            AidsArgument::Default => (true, None),
            AidsArgument::Bare => (bare.is_none(), bare),
            AidsArgument::All => (aided.is_none(), aided),
            AidsArgument::Both => (true, bare),
        };
        let other = other.map(Method::of).transpose()?;
        for row in keeps_own.then_some(method).into_iter().chain(other) {
            if rows.iter().all(|earlier| earlier.id != row.id) {
                rows.push(row);
            }
        }
    }
    Ok(rows)
}

/// Returns ids and files of scenes, sorted by id.
///
/// # Errors
/// When one cannot be read, a folder holds none, or two have one id.
pub(crate) fn scenes(paths: &[PathBuf]) -> anyhow::Result<Vec<(String, PathBuf)>> {
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            let before = files.len();
            search(path, &mut files)?;
            if files.len() == before {
                let path = path.display();
                let reason = format!(
                    "{path}: must hold a {SCENE_FILE}, in it or below; `curate poses` and `curate import` write one"
                );
                return Err(BadRequest(reason).into());
            }
        } else {
            files.push(path.clone());
        }
    }
    files.sort();
    files.dedup();
    let mut scenes: BTreeMap<String, PathBuf> = BTreeMap::new();
    for file in files {
        let scene: Scene = store::read_record(&file)?;
        let file = absolute(&file)?;
        if let Some(other) = scenes.get(&scene.id) {
            let (id, file, other) = (&scene.id, file.display(), other.display());
            return Err(BadRequest(format!("{file}: is of scene {id}, as {other} is")).into());
        }
        scenes.insert(scene.id, file);
    }
    Ok(scenes.into_iter().collect())
}

fn search(folder: &Path, found: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    for path in store::paths_in(folder)? {
        let name = path.file_name().unwrap_or_default();
        if path.is_dir() && !name.as_encoded_bytes().starts_with(b".") {
            search(&path, found)?;
        } else if name == SCENE_FILE {
            found.push(path);
        }
    }
    Ok(())
}

/// Returns the folder of a scene's results, below the folder of all results and never outside of it.
fn scene_folder(id: &str) -> PathBuf {
    id.split('/').map(plan::file_name).collect()
}

/// Method with its way of running.
pub(crate) struct Method {
    pub(crate) id: String,
    pub(crate) kind: MethodKind,
}

pub(crate) enum MethodKind {
    /// A method of this program, in the requested variant.
    Ours(&'static OurMethod, Variant),
    /// External method, by its method.toml.
    External(PathBuf),
}

impl Method {
    /// Finds the method of this name, or of this method.toml.
    ///
    /// # Errors
    /// When the name is unknown, or the file is invalid.
    fn find(name: &str) -> anyhow::Result<Self> {
        if name.ends_with(".toml") {
            let manifest = absolute(Path::new(name))?;
            return Ok(Self {
                id: Manifest::read(&manifest)?.id,
                kind: MethodKind::External(manifest),
            });
        }
        Self::of(Variant::parse(name)?)
    }

    /// Returns a method of this program in this variant.
    ///
    /// # Errors
    /// When it does not exist.
    fn of(variant: Variant) -> anyhow::Result<Self> {
        Ok(Self {
            id: variant.to_string(),
            kind: MethodKind::Ours(methods::find(variant.method)?, variant),
        })
    }
}

impl Method {
    pub(crate) fn is_trained(&self) -> bool {
        matches!(self.kind, MethodKind::Ours(method, _) if method.is_trained())
    }

    /// Returns whether inputs have to be made for it first.
    fn has_requirements(&self) -> bool {
        matches!(self.kind, MethodKind::Ours(method, _) if !method.requires.is_empty())
    }

    /// Returns whether another seed would give the same views.
    fn has_no_seed(&self) -> bool {
        matches!(self.kind, MethodKind::Ours(method, _) if !method.is_trained())
    }
}

/// Work of one unit.
struct Work<'a> {
    results: &'a Path,
    /// Id and file of the scene.
    scene: (&'a str, &'a Path),
    protocol: &'a str,
    method: &'a Method,
    /// Methods of the benchmark whose inputs have to be made first.
    requiring: &'a [&'a Method],
    seed: u64,
    train: &'a [String],
    tensorboard: Option<&'a Path>,
    /// Weights of the networks that score its views.
    networks: &'a [String],
    needs: UnitNeeds,
}

impl Work<'_> {
    fn unit(&self) -> anyhow::Result<SweepUnit> {
        let (id, file) = self.scene;
        let folder = self.results.join(scene_folder(id)).join(self.protocol);
        let split = argument(&folder.join(SPLIT_FILE))?;
        let seed = self.seed.to_string();
        let folder = folder.join(&self.method.id).join(format!("seed-{seed}"));
        let run = folder.join("run");
        let scene = argument(file)?;
        let make_split = own_command(words(&[
            "bench",
            "split",
            &scene,
            "--protocol",
            self.protocol,
            "--out",
            &split,
        ]))?;
        let scored = |record: &Path| scoring(&scene, &split, record, &folder.join("score"));
        let record = run.join(match self.method.kind {
            MethodKind::External(_) => EXTERNAL_RUN_FILE,
            MethodKind::Ours(..) => RUN_FILE,
        });
        let failed = folder.join("failed");
        let record_failure = own_command(words(&[
            "bench",
            "failed",
            &self.method.id,
            "--scene",
            &scene,
            "--split",
            &split,
            "--seed",
            &seed,
            "--reason",
            "{reason}",
            "--out",
            &argument(&failed)?,
            "--run",
            &argument(&run)?,
        ]))?;
        let mut inputs = vec![scene.clone()];
        inputs.extend_from_slice(self.networks);
        if let MethodKind::External(manifest) = &self.method.kind {
            inputs.push(argument(manifest)?);
            for script in own_files(manifest)? {
                inputs.push(argument(&script)?);
            }
        }
        let name = plan::file_name(&format!(
            "{id}.{}.{}.seed-{seed}",
            self.protocol, self.method.id
        ));
        Ok(SweepUnit {
            id: name.clone(),
            group: format!("{} {}", self.protocol, self.method.id),
            labels: [
                ("scene", id),
                ("protocol", self.protocol),
                ("method", &self.method.id),
                ("seed", &seed),
            ]
            .map(|(label, value)| (label.to_owned(), value.to_owned()))
            .into(),
            commands: [
                vec![make_split.clone()],
                self.preparation(&scene, &split)?,
                vec![
                    self.training(&name, [&scene, &split], &seed, &argument(&run)?)?,
                    scored(&record)?,
                ],
            ]
            .concat(),
            on_failure: vec![
                make_split,
                record_failure,
                scored(&failed.join(EXTERNAL_RUN_FILE))?,
            ],
            inputs,
            outputs: vec![argument(&folder.join("score/result.json"))?],
            needs: self.needs,
        })
    }

    /// Returns the commands that make the method's requirements and, as far as the scene allows it, those of the
    /// other methods of the benchmark.
    fn preparation(&self, scene: &str, split: &str) -> anyhow::Result<Vec<Vec<String>>> {
        let (own, others): (Vec<&Method>, Vec<&Method>) =
            (self.requiring.iter().copied()).partition(|method| method.id == self.method.id);
        let mut commands = Vec::new();
        for (methods, option) in [(own, None), (others, Some("--where-possible"))] {
            let ids = methods.iter().filter_map(|method| match &method.kind {
                MethodKind::Ours(method, _) => Some(method.id),
                MethodKind::External(_) => None,
            });
            let ids: Vec<&str> = ids.collect();
            if ids.is_empty() {
                continue;
            }
            let mut command = words(&["reconstruct", "prepare", scene, "--split", split]);
            command.extend(words(&["--methods", &ids.join(",")]));
            command.extend(option.map(str::to_owned));
            commands.push(own_command(command)?);
        }
        Ok(commands)
    }

    fn training(
        &self,
        name: &str,
        [scene, split]: [&str; 2],
        seed: &str,
        run: &str,
    ) -> anyhow::Result<Vec<String>> {
        let common = ["--split", split, "--seed", seed, "--out", run];
        let mut command = match &self.method.kind {
            MethodKind::External(manifest) => {
                let manifest = argument(manifest)?;
                words(&[
                    "bench",
                    "external",
                    "--accept-failures",
                    &manifest,
                    "--scene",
                    scene,
                ])
            }
            MethodKind::Ours(_, variant) => {
                let mut command =
                    words(&["reconstruct", "train", scene, "--method", variant.method]);
                let plan = variant.plan.as_ref().map(plan_word);
                let with = variant.with.iter().map(|name| ("--with", name));
                let without = variant.without.iter().map(|name| ("--without", name));
                let plan = plan.iter().map(|plan| ("--plan", plan));
                for (option, value) in with.chain(without).chain(plan) {
                    command.extend(words(&[option, value]));
                }
                for line in variant.constants.lines() {
                    command.extend(words(&["--set", &line]));
                }
                command
            }
        };
        command.extend(words(&common));
        if self.method.is_trained() {
            command.extend(self.train.iter().cloned());
            if let Some(folder) = self.tensorboard {
                command.extend(tensorboard(&folder.join(name))?);
            }
        }
        own_command(command)
    }
}
