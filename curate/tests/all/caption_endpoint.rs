//! Captions by an endpoint, against a server of the test's own on this machine.

use std::{
    collections::VecDeque,
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::{TcpListener, TcpStream},
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
    thread,
    time::Duration,
};

use base64::{Engine, engine::general_purpose::STANDARD};
use omnilife_curate::{
    CurateSettings,
    annotation::{
        AnnotateSettings, CaptionEndpoint, annotate_dataset,
        endpoint::{Key, PROMPT, RetryPolicy},
    },
    curate_dataset,
};
use omnilife_schemas::{
    layout::ANNOTATION_FILE,
    progress::Silent,
    records::{Annotation, Sampling},
    store,
};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::support;

const KEY: &str = "sk-very-secret";

/// A server's reply to one request.
#[derive(Clone)]
enum Reply {
    /// A status line's rest, further headers, and a body.
    Send(&'static str, &'static str, String),
    /// Is silent for longer than any time limit.
    Hang,
    /// Closes the connection.
    Close,
}

impl Reply {
    fn caption(text: &str) -> Self {
        let body = json!({ "choices": [{ "message": { "role": "assistant", "content": text },
            "finish_reason": "stop" }] });
        Self::Send("200 OK", "", body.to_string())
    }
}

/// A request as it came: the first line, headers in lower case, the body.
struct HttpRequest {
    first_line: String,
    headers: Vec<String>,
    body: Vec<u8>,
}

/// Answers requests one after the other.
struct Server {
    url: String,
    asked: Arc<Mutex<Vec<HttpRequest>>>,
    replies: Arc<Mutex<VecDeque<Reply>>>,
}

impl Server {
    fn start(replies: impl IntoIterator<Item = Reply>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/v1", listener.local_addr().unwrap());
        let asked = Arc::new(Mutex::new(Vec::new()));
        let replies = Arc::new(Mutex::new(replies.into_iter().collect()));
        let server = Self {
            url,
            asked: Arc::clone(&asked),
            replies: Arc::clone(&replies),
        };
        thread::spawn(move || {
            for stream in listener.incoming() {
                let stream = stream.unwrap();
                let (asked, replies) = (Arc::clone(&asked), Arc::clone(&replies));
                thread::spawn(move || answer(stream, &asked, &replies));
            }
        });
        server
    }

    fn count(&self) -> usize {
        self.asked.lock().unwrap().len()
    }
}

fn answer(
    mut stream: TcpStream,
    asked: &Mutex<Vec<HttpRequest>>,
    replies: &Mutex<VecDeque<Reply>>,
) {
    let mut reader = BufReader::new(stream.try_clone().unwrap());
    let mut line = String::new();
    if reader.read_line(&mut line).unwrap_or(0) == 0 {
        return;
    }
    let first_line = line.trim().to_owned();
    let mut headers = Vec::new();
    let mut length = 0;
    loop {
        let mut header = String::new();
        reader.read_line(&mut header).unwrap();
        let header = header.trim().to_owned();
        if header.is_empty() {
            break;
        }
        let lower = header.to_lowercase();
        if let Some(bytes) = lower.strip_prefix("content-length:") {
            length = bytes.trim().parse().unwrap();
        }
        headers.push(match lower.starts_with("authorization") {
            true => header,
            false => lower,
        });
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).unwrap();
    asked.lock().unwrap().push(HttpRequest {
        first_line,
        headers,
        body,
    });
    let reply = replies.lock().unwrap().pop_front().unwrap_or(Reply::Close);
    match reply {
        Reply::Send(status, headers, body) => {
            let head = format!(
                "HTTP/1.1 {status}\r\nContent-Type: application/json\r\nConnection: close\r\n\
                 {headers}Content-Length: {}\r\n\r\n",
                body.len()
            );
            // One that has read enough hangs up.
            let _ = stream
                .write_all(head.as_bytes())
                .and_then(|()| stream.write_all(body.as_bytes()));
        }
        Reply::Hang => thread::sleep(Duration::from_secs(30)),
        Reply::Close => {}
    }
}

/// A dataset of one video, two worlds, two sequences.
fn dataset() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let video = support::erp_clip(folder.path(), "walk.mp4", &[1, 3], 20, 10);
    let out = folder.path().join("set");
    let settings = CurateSettings {
        enforce: false,
        sampling: Sampling::MaxFrames(6),
        ..CurateSettings::default()
    };
    let curated = curate_dataset(&[video], &out, &settings, &Silent).unwrap();
    assert!(curated.errors.is_empty(), "{:?}", curated.errors);
    (folder, out)
}

fn settings(server: &Server) -> AnnotateSettings {
    AnnotateSettings {
        endpoint: Some(CaptionEndpoint {
            endpoint: server.url.parse().unwrap(),
            model: "see-1".to_owned(),
            key: Some(Key::new(KEY).unwrap()),
            patience: RetryPolicy {
                timeout: Duration::from_secs(20),
                attempts: 3,
                first_wait: Duration::from_millis(5),
            },
        }),
        ..AnnotateSettings::default()
    }
}

fn captions(out: &Path, sequence: &str) -> Vec<(String, String)> {
    let path = out.join("videos/walk").join(sequence).join(ANNOTATION_FILE);
    let annotation: Annotation = store::read_record(&path).unwrap();
    let captions = annotation.captions.into_iter();
    captions.map(|one| (one.author, one.text)).collect()
}

/// Every file of a folder holds nothing of the key.
fn assert_no_key(folder: &Path) {
    for path in store::paths_in(folder).unwrap() {
        if path.is_dir() {
            assert_no_key(&path);
        } else {
            let bytes = fs::read(&path).unwrap();
            let found = bytes.windows(KEY.len()).any(|w| w == KEY.as_bytes());
            assert!(!found, "{} holds the key", path.display());
        }
    }
}

#[test]
fn views_are_sent_captions_entered_and_nothing_is_asked_twice() {
    let (_folder, out) = dataset();
    let server = Server::start([
        Reply::Send("503 Service Unavailable", "", "busy".to_owned()),
        Reply::caption("  A market\n at night. "),
        Reply::Send("429 Too Many Requests", "Retry-After: 0\r\n", String::new()),
        Reply::caption("A beach."),
    ]);
    annotate_dataset(&out, &settings(&server), &Silent).unwrap();
    let said = |text: &str| vec![("see-1".to_owned(), text.to_owned())];
    assert_eq!(captions(&out, "seq-000"), said("A market at night."));
    assert_eq!(captions(&out, "seq-001"), said("A beach."));
    {
        let asked = server.asked.lock().unwrap();
        assert_eq!(asked.len(), 4);
        let first = &asked[0];
        assert_eq!(first.first_line, "POST /v1/chat/completions HTTP/1.1");
        let key = format!("Bearer {KEY}");
        assert!(
            first.headers.iter().any(|header| header.ends_with(&key)),
            "{:?}",
            first.headers
        );
        assert_eq!(first.body, asked[1].body, "the same is asked again");
        let body: Value = serde_json::from_slice(&first.body).unwrap();
        assert_eq!(body["model"], "see-1");
        let content = body["messages"][0]["content"].as_array().unwrap();
        assert_eq!(content[0], json!({ "type": "text", "text": PROMPT }));
        // Four moments, four views each, at the resolution of the panorama of 256 pixels.
        assert_eq!(content.len(), 17);
        for part in &content[1..] {
            let url = part["image_url"]["url"].as_str().unwrap();
            let bytes = url.strip_prefix("data:image/jpeg;base64,").unwrap();
            let image = image::load_from_memory(&STANDARD.decode(bytes).unwrap()).unwrap();
            assert_eq!((image.width(), image.height()), (81, 81));
        }
    }
    // Again: everything is kept, nothing is asked.
    annotate_dataset(&out, &settings(&server), &Silent).unwrap();
    assert_eq!(server.count(), 4);
    assert_eq!(captions(&out, "seq-001"), said("A beach."));
    assert_no_key(&out);

    // Another model is another question, and its captions stand beside the others.
    let mut other = settings(&server);
    other.endpoint.as_mut().unwrap().model = "see-2".to_owned();
    server
        .replies
        .lock()
        .unwrap()
        .extend([Reply::caption("Stalls."), Reply::caption("Sand.")]);
    annotate_dataset(&out, &other, &Silent).unwrap();
    assert_eq!(server.count(), 6);
    assert_eq!(captions(&out, "seq-000").len(), 2);
}

#[test]
fn what_an_endpoint_does_wrong_is_one_line_and_what_is_captioned_is_kept() {
    let (_folder, out) = dataset();
    let text = |body: &str| Reply::Send("200 OK", "", body.to_owned());
    let echo = json!({ "error": { "message": format!("Incorrect API key\n{KEY}") } }).to_string();
    let endless = format!("{{\"choices\": \"{}\"}}", "x".repeat(2 << 20));
    let cut =
        json!({ "choices": [{ "message": { "content": "A mar" }, "finish_reason": "length" }] });
    let cases: Vec<(Vec<Reply>, &str, usize)> = vec![
        (
            vec![Reply::Send("401 Unauthorized", "", echo)],
            "status 401 Unauthorized: Incorrect API key (the key)",
            1,
        ),
        (
            vec![Reply::Send("404 Not Found", "", "no model".to_owned())],
            "no model",
            1,
        ),
        (vec![text("not JSON")], "must be a chat completion", 1),
        (vec![text("{\"choices\": []}")], "no choices", 1),
        (vec![Reply::caption(" ")], "no text", 1),
        (
            vec![Reply::caption(&"long ".repeat(5000))],
            "more than 8000 characters",
            1,
        ),
        (vec![text(&cut.to_string())], "ran out of room", 1),
        (vec![text(&endless)], "answers more than 1048576 bytes", 1),
        (
            vec![Reply::Send(
                "307 Temporary Redirect",
                "Location: http://127.0.0.1:9/\r\n",
                String::new(),
            )],
            "",
            1,
        ),
        (
            vec![Reply::Send("500 Internal Server Error", "", String::new()); 5],
            "status 500 Internal Server Error (3 attempts)",
            3,
        ),
        (vec![Reply::Close; 5], "(3 attempts)", 3),
        (
            vec![Reply::Send(
                "429 Too Many Requests",
                "Retry-After: 3600\r\n",
                String::new(),
            )],
            "3600 s",
            1,
        ),
    ];
    for (replies, said, asked) in cases {
        let server = Server::start(replies);
        let error = annotate_dataset(&out, &settings(&server), &Silent).unwrap_err();
        let message = error.to_string();
        assert!(message.contains(said), "{message} lacks {said}");
        assert!(
            message.contains("walk/seq-000") && message.contains("see-1"),
            "{message}"
        );
        assert_eq!(message.lines().count(), 1, "{message}");
        assert!(!message.contains(KEY), "{message}");
        assert_eq!(server.count(), asked, "{said}");
    }
    // One that hangs is not waited for longer than asked.
    let server = Server::start(vec![Reply::Hang; 3]);
    let mut impatient = settings(&server);
    impatient.endpoint.as_mut().unwrap().patience.timeout = Duration::from_millis(300);
    let message = annotate_dataset(&out, &impatient, &Silent)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("does not answer within 0.3 s"),
        "{message}"
    );

    // The first sequence is captioned, the second not: the next run asks for the second alone.
    let server = Server::start([
        Reply::caption("A market."),
        Reply::Send("400 Bad Request", "", String::new()),
        Reply::caption("A beach."),
    ]);
    let message = annotate_dataset(&out, &settings(&server), &Silent)
        .unwrap_err()
        .to_string();
    assert!(message.contains("walk/seq-001"), "{message}");
    annotate_dataset(&out, &settings(&server), &Silent).unwrap();
    assert_eq!(server.count(), 3);
    assert_eq!(captions(&out, "seq-001")[0].1, "A beach.");
    assert_no_key(&out);
}
