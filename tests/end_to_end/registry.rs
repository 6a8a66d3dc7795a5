//! Every row of the list of methods through every command that takes a method: success, or the refusal that follows
//! from the row.

use std::{fs, iter, path::PathBuf};

use omnilife_reconstruct::{
    formats::OBJECTS_FILE,
    methods::{self, METHODS, Method, requirement::Requirement},
    models::ModelFormat,
    request::BackendChoice,
};
use tempfile::TempDir;

use crate::support::{
    Ended, SEQUENCE, copy_of_small_run, files, omnilife, scratch, small_run, write_tracked_split,
};

/// Options that make a training short, for the methods that have them.
const SMALL_OPTIONS: [(&str, &str); 4] = [
    ("max-gaussians", "400"),
    ("rays", "64"),
    ("base-fields", "tiny"),
    ("motion-fields", "tiny"),
];

/// Returns the words that refuse a requirement on the sample, panoramas of a moving camera, before it is prepared;
/// `None` where the sample meets it.
fn refusal_of(requirement: Requirement) -> Option<&'static str> {
    match requirement {
        Requirement::Parallax | Requirement::DensePoints => None,
        Requirement::Tracks => Some("has no tracks"),
    }
}

/// Walk of one method on the sample, with a folder for its split and its outputs.
struct Walk {
    method: &'static Method,
    folder: TempDir,
}

impl Walk {
    fn new(method: &'static Method) -> Self {
        let folder = scratch();
        let split = small_run().out.join(SEQUENCE).join("per-scene/split.json");
        fs::create_dir(folder.path().join("split")).unwrap();
        fs::copy(split, folder.path().join("split/split.json")).unwrap();
        Self { method, folder }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs a command quietly. `SCENE` stands for the sample, `METHOD` for the method with its small options, `@name`
    /// for a name in the folder.
    fn run(&self, words: &str) -> Ended {
        let scene = small_run().out.join(SEQUENCE);
        let has = |id: &str| self.method.options.iter().any(|option| option.id == id);
        let options = SMALL_OPTIONS.iter().filter(|(id, _)| has(id));
        let options = options.map(|(id, value)| format!(" --set {id}={value}"));
        let method = format!("--method {}{}", self.method.id, options.collect::<String>());
        let words = words.replace("METHOD", &method);
        let fill = |word: &str| match word.strip_prefix('@') {
            Some(name) => self.at(name).to_str().unwrap().to_owned(),
            None if word == "SCENE" => scene.to_str().unwrap().to_owned(),
            None => word.to_owned(),
        };
        let words = words.split_whitespace().map(fill);
        omnilife(iter::once("--quiet".to_owned()).chain(words))
    }

    /// Returns the whole files in an output folder, without the records of stages.
    #[track_caller]
    fn left(&self, out: &str) -> Vec<String> {
        let out = self.at(out);
        if !out.exists() {
            return Vec::new();
        }
        let mut left = files(&out);
        assert!(
            left.iter().all(|file| !file.contains(".tmp-")),
            "{}: {left:?}",
            self.method.id
        );
        left.retain(|file| !file.starts_with(".done/"));
        left
    }

    /// Runs a command that writes into `@out`, and checks that it succeeds and writes, or that it is refused in a line
    /// with the method's name and `refusal`, and writes nothing.
    #[track_caller]
    fn check(&self, words: &str, out: &str, refusal: Option<&str>) {
        let id = self.method.id;
        println!("{id}: {words}");
        let ended = self.run(&format!("{words} --out @{out}"));
        match refusal {
            None => {
                ended.succeeded();
                assert!(!self.left(out).is_empty(), "{id}: {words}");
            }
            Some(refusal) => {
                let message = ended.failed_quietly(2);
                let is_told = message.contains(id) && message.contains(refusal);
                assert!(is_told, "{id}: {words}: {message}");
                assert_eq!(self.left(out), [""; 0], "{id}: {words}");
            }
        }
    }

    /// Trains without the inputs that the method requires, and on a backend that it lacks.
    fn train_in_vain(&self) {
        let train = "reconstruct train SCENE --split @split METHOD --iterations 5";
        let mut refusals = self.method.requires.iter().copied().filter_map(refusal_of);
        if let Some(refusal) = refusals.next() {
            self.check(train, "too-early", Some(refusal));
        }
        if !self.method.backends.contains(&BackendChoice::Gpu) {
            let train = format!("{train} --backend gpu");
            self.check(&train, "on-gpu", Some("no GPU kernels"));
        }
    }

    /// Makes everything that the method requires: files beside the split, exactly where the sample lacks something.
    fn prepare(&self) {
        let id = self.method.id;
        let words = format!("reconstruct prepare SCENE --split @split --methods {id}");
        self.run(&words).succeeded();
        let mut requirements = self.method.requires.iter().copied();
        let lacks_any = requirements.any(|requirement| refusal_of(requirement).is_some());
        let made = self.left("split");
        assert_eq!(made.len() > 1, lacks_any, "{id}: {made:?}");
        let has_objects = |model: &ModelFormat| model.files.contains(&OBJECTS_FILE);
        if self.method.model().is_some_and(has_objects) {
            // The sample's own track may be of a static object, and methods that can do without have none.
            write_tracked_split(&self.at("split"));
        }
    }

    fn plan(&self) {
        let ended = self.run("reconstruct plan SCENE --split @split METHOD --iterations 30");
        if self.method.is_trained() {
            let text = ended.succeeded().stdout;
            assert!(text.starts_with(self.method.id), "{text}");
        } else {
            let message = ended.failed_quietly(2);
            assert!(message.contains(self.method.id), "{message}");
            assert!(message.contains("has no training"), "{message}");
        }
    }

    /// Trains, and checks that no files but those of the method's kind of model are left of any model.
    fn train(&self) {
        let train = "reconstruct train SCENE --split @split METHOD --iterations 5 --trace-views 0";
        self.check(train, "run", None);
        assert!(self.at("run/run.json").is_file());
        let mut left = methods::model_files();
        left.retain(|file| self.at("run").join(file).is_file());
        let own: &[&str] = match self.method.model() {
            Some(model) => model.files,
            None => &[],
        };
        assert_eq!(left.is_empty(), own.is_empty(), "{}", self.method.id);
        assert!(left.iter().all(|file| own.contains(file)), "{left:?}");
    }

    /// Renders, exports, edits and scores the run.
    fn use_run(&self) {
        let render = "reconstruct render @run --poses SCENE --size 32x16 --layer all";
        self.check(render, "views", self.refusal(|_| true, ""));
        let without_splats = self.refusal(ModelFormat::has_splats, "no Gaussians for viewers");
        self.check("reconstruct export @run", "asset", without_splats);
        let without_textures = self.refusal(|model| model.textures().is_some(), "no atlas");
        self.check("reconstruct atlas @run", "atlas", without_textures);
        let without_parts = self.refusal(|model| model.edit.is_some(), "no parts to edit");
        let part = match without_parts {
            None => self.first_part(),
            Some(_) => "any".to_owned(),
        };
        self.write_removal(&part);
        let edit = "reconstruct edit @run --script @edit.toml";
        self.check(edit, "edited", without_parts);
        if without_parts.is_none() {
            let render = "reconstruct render @edited --poses SCENE --size 32x16";
            self.check(render, "edited-views", None);
        }
        let score = "bench score --scene SCENE --split @split --run @run --without-lpips";
        self.check(score, "score", None);
    }

    /// Returns the words that refuse a command on a run of the method: those of a method without a model, or
    /// `otherwise` of a model that lacks the requested feature.
    fn refusal(
        &self,
        has: fn(&ModelFormat) -> bool,
        otherwise: &'static str,
    ) -> Option<&'static str> {
        match self.method.model() {
            None => Some("leaves no model"),
            Some(model) => (!has(model)).then_some(otherwise),
        }
    }

    /// Returns the name of the first part of the run's model, from the line that refuses an unknown one.
    fn first_part(&self) -> String {
        self.write_removal("no such part");
        let ended = self.run("reconstruct edit @run --script @edit.toml --out @none");
        let message = ended.failed_quietly(2);
        let (_, parts) = message.split_once("must be one of ").unwrap();
        assert_eq!(self.left("none"), [""; 0]);
        parts.split(", ").next().unwrap().to_owned()
    }

    fn write_removal(&self, part: &str) {
        let script = format!("[[edit]]\nkind = \"remove\"\nobject = \"{part}\"\n");
        fs::write(self.at("edit.toml"), script).unwrap();
    }
}

#[test]
fn every_method_goes_through_every_command() {
    for method in METHODS {
        let walk = Walk::new(method);
        walk.train_in_vain();
        walk.prepare();
        walk.plan();
        walk.train();
        walk.use_run();
    }
}

/// A benchmark makes what its methods require, so that each of them is scored.
#[test]
fn every_method_can_be_benchmarked() {
    let sequence = small_run().out.join(SEQUENCE);
    let folder = scratch();
    let out = folder.path().join("bench");
    let ids: Vec<&str> = METHODS.iter().map(|method| method.id).collect();
    let ended = omnilife([
        "bench",
        "run",
        sequence.to_str().unwrap(),
        "--methods",
        &ids.join(","),
        "--protocols",
        "per-scene",
        "--iterations",
        "4",
        "--out",
        out.to_str().unwrap(),
    ]);
    let outcomes = fs::read_to_string(out.join("outcomes.csv")).unwrap();
    for id in ids {
        let mut lines = outcomes.lines();
        let line = lines
            .find(|line| line.contains(&format!(",{id},")))
            .unwrap();
        assert!(line.contains(",scored,"), "{line}\n{}", ended.stderr);
    }
    ended.succeeded();
}

/// A hovering camera without planar ground shows motion but no geometry, so nothing can be reconstructed from it.
#[test]
fn methods_that_need_parallax_refuse_a_camera_that_hovers() {
    let copy = copy_of_small_run();
    let scene = copy.path().join(SEQUENCE).join("scene.json");
    let mut record: serde_json::Value = serde_json::from_slice(&fs::read(&scene).unwrap()).unwrap();
    record["pose_source"] = serde_json::json!({
        "kind": "registered", "reason": "97 % of the pixels fit a turn", "succeeded": true
    });
    fs::write(&scene, record.to_string()).unwrap();
    let out = copy.path().join("run");
    let split = copy.path().join(SEQUENCE).join("per-scene/split.json");
    let needing = |method: &&Method| method.needs(Requirement::Parallax);
    for method in METHODS.iter().filter(needing) {
        let ended = omnilife([
            "reconstruct".as_ref(),
            "train".as_ref(),
            scene.as_os_str(),
            "--split".as_ref(),
            split.as_os_str(),
            "--method".as_ref(),
            method.id.as_ref(),
            "--out".as_ref(),
            out.as_os_str(),
        ]);
        let message = ended.failed_quietly(2);
        assert!(
            message.contains(method.id)
                && message.contains("hovers or turns (97 % of the pixels fit a turn)")
                && message.contains("nothing can be reconstructed"),
            "{message}"
        );
        assert!(!out.exists());
    }
}
