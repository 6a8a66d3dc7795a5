//! Requests to a chat-completions endpoint over HTTP or HTTPS, with retries and limits.
//!
//! Retried are temporary refusals (status 429 and 5xx) and connections that fail or time out: a bounded number of
//! times, with doubled waits or after the server's `Retry-After`. Redirects are not followed, so that the key goes
//! nowhere else; no message contains the key.

use std::{fmt, net::IpAddr, str::FromStr, sync::Arc, thread, time::Duration};

use omnilife_schemas::progress::Progress;
use serde::{Deserialize, Serialize};
use ureq::{
    Agent,
    http::{Response, Uri},
    tls::{Certificate, RootCerts, TlsConfig},
};

/// Maximum response size.
const MOST_ANSWER_BYTES: u64 = 1 << 20;
/// Maximum length of a caption.
const MOST_CAPTION_CHARACTERS: usize = 8_000;
/// Maximum length of a server's error text in messages.
const SHOWN_CHARACTERS: usize = 200;
/// Longest `Retry-After` that is honoured.
const LONGEST_WAIT: Duration = Duration::from_secs(60);
/// End of the protocol's path.
const PATH: &str = "/chat/completions";

/// Address of a chat-completions endpoint.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoint {
    url: String,
    is_encrypted: bool,
    is_here: bool,
}

impl FromStr for Endpoint {
    type Err = String;

    /// Parses an address up to `/v1` or up to `/chat/completions`.
    fn from_str(text: &str) -> Result<Self, String> {
        let uri: Uri = text.parse().map_err(|error| {
            format!("must be an address such as http://localhost:8000/v1, got {text:?}: {error}")
        })?;
        let is_encrypted = match uri.scheme_str() {
            Some("https") => true,
            Some("http") => false,
            _ => return Err(format!("{text:?} does not begin with http:// or https://")),
        };
        let authority = uri.authority().map_or("", |authority| authority.as_str());
        if authority.contains('@') {
            return Err(
                "the address holds a name or a key; keys come from the environment".to_owned(),
            );
        }
        if uri.query().is_some() {
            return Err(format!("{text:?} has a query, and endpoints have none"));
        }
        let host = uri.host().unwrap_or_default();
        if host.is_empty() {
            return Err(format!("{text:?} names no host"));
        }
        let address = host.trim_matches(['[', ']']).parse::<IpAddr>();
        let trimmed = text.trim_end_matches('/');
        Ok(Self {
            url: match trimmed.ends_with(PATH) {
                true => trimmed.to_owned(),
                false => format!("{trimmed}{PATH}"),
            },
            is_encrypted,
            is_here: host == "localhost" || address.is_ok_and(|address| address.is_loopback()),
        })
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.url)
    }
}

/// A secret: it can be sent, but neither printed nor recorded.
#[derive(Clone, PartialEq, Eq)]
pub struct Key(String);

impl Key {
    /// # Errors
    /// When it cannot stand in a header. The error does not contain it.
    pub fn new(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if text.is_empty() || !text.bytes().all(|byte| byte.is_ascii_graphic()) {
            return Err("holds no key: one is printable ASCII without spaces".to_owned());
        }
        Ok(Self(text.to_owned()))
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Key(hidden)")
    }
}

/// Time limits and retries of requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RetryPolicy {
    /// Time limit of one answer, from the connection to its last byte.
    pub timeout: Duration,
    /// Attempts in all, at least one.
    pub attempts: u32,
    /// Wait before the second attempt; doubled before every further one.
    pub first_wait: Duration,
}

impl Default for RetryPolicy {
    fn default() -> Self {
        Self {
            timeout: Duration::from_secs(120),
            attempts: 5,
            first_wait: Duration::from_secs(2),
        }
    }
}

/// Body of a request.
#[derive(Debug, Serialize)]
pub(super) struct ChatRequest<'a> {
    model: &'a str,
    messages: [Message<'a>; 1],
}

#[derive(Debug, Serialize)]
struct Message<'a> {
    role: &'static str,
    content: Vec<Part<'a>>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case", tag = "type")]
enum Part<'a> {
    Text { text: &'a str },
    ImageUrl { image_url: ImageUrl<'a> },
}

#[derive(Debug, Serialize)]
struct ImageUrl<'a> {
    url: &'a str,
}

impl<'a> ChatRequest<'a> {
    /// Creates a request about images, which are data URLs.
    pub(super) fn new(model: &'a str, prompt: &'a str, images: &'a [String]) -> Self {
        let text = [Part::Text { text: prompt }].into_iter();
        let images = images.iter().map(|url| Part::ImageUrl {
            image_url: ImageUrl { url },
        });
        Self {
            model,
            messages: [Message {
                role: "user",
                content: text.chain(images).collect(),
            }],
        }
    }
}

#[derive(Deserialize)]
struct Answer {
    choices: Vec<Choice>,
}

#[derive(Deserialize)]
struct Choice {
    message: AnswerMessage,
    finish_reason: Option<String>,
}

#[derive(Deserialize)]
struct AnswerMessage {
    content: Option<String>,
}

/// Body of a refusal.
#[derive(Deserialize)]
struct Refusal {
    error: RefusalReason,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum RefusalReason {
    Object { message: String },
    Text(String),
}

/// Failure of one attempt.
enum AttemptError {
    /// May succeed later; the server may have stated a wait.
    Passing(String, Option<Duration>),
    /// Not to be retried.
    Final(String),
}

/// A connection to an endpoint.
pub(super) struct ChatClient<'a> {
    endpoint: &'a Endpoint,
    key: Option<&'a Key>,
    patience: RetryPolicy,
    agent: Agent,
}

impl<'a> ChatClient<'a> {
    /// # Errors
    /// One line: the key would go over the network unencrypted, or this machine has no certificates to verify servers
    /// by.
    pub(super) fn new(
        endpoint: &'a Endpoint,
        key: Option<&'a Key>,
        patience: RetryPolicy,
    ) -> Result<Self, String> {
        if key.is_some() && !endpoint.is_encrypted && !endpoint.is_here {
            return Err(
                "the key is not sent unencrypted to another machine; use https://".to_owned(),
            );
        }
        let mut config = Agent::config_builder()
            .timeout_global(Some(patience.timeout))
            .http_status_as_error(false)
            .max_redirects(0)
            .user_agent(concat!("omnilife/", env!("CARGO_PKG_VERSION")));
        if endpoint.is_here {
            config = config.proxy(None);
        }
        if endpoint.is_encrypted {
            config = config.tls_config(tls()?);
        }
        Ok(Self {
            endpoint,
            key,
            patience,
            agent: config.build().into(),
        })
    }

    /// Returns the model's answer.
    ///
    /// # Errors
    /// One line.
    pub(super) fn ask(
        &self,
        request: &ChatRequest<'_>,
        progress: &dyn Progress,
    ) -> Result<String, String> {
        let body = serde_json::to_vec(request).map_err(|error| error.to_string())?;
        let mut wait = self.patience.first_wait;
        for attempt in 1.. {
            let (reason, asked) = match self.attempt(&body) {
                Ok(caption) => return Ok(caption),
                Err(AttemptError::Final(reason)) => return Err(self.without_key(&reason)),
                Err(AttemptError::Passing(reason, asked)) => (self.without_key(&reason), asked),
            };
            let pause = asked.unwrap_or(wait);
            if attempt >= self.patience.attempts {
                return Err(format!("{reason} ({attempt} attempts)"));
            }
            if pause > LONGEST_WAIT {
                return Err(format!(
                    "{reason}, and asks for {} s of patience; run again later, what is captioned is kept",
                    pause.as_secs()
                ));
            }
            progress.status(&format!("{reason}; again in {:.1} s", pause.as_secs_f64()));
            thread::sleep(pause);
            wait *= 2;
        }
        Err("was never asked".to_owned())
    }

    fn attempt(&self, body: &[u8]) -> Result<String, AttemptError> {
        let mut request = self
            .agent
            .post(&self.endpoint.url)
            .content_type("application/json");
        if let Some(Key(key)) = self.key {
            request = request.header("Authorization", format!("Bearer {key}"));
        }
        let answered = request.send(body);
        let mut response = answered.map_err(|error| of_transport(&error, self.patience.timeout))?;
        let status = response.status();
        let asked = seconds_asked_for(&response);
        let content = response
            .body_mut()
            .with_config()
            .limit(MOST_ANSWER_BYTES)
            .read_to_vec()
            .map_err(|error| of_transport(&error, self.patience.timeout))?;
        if status.is_success() {
            return caption(&content).map_err(AttemptError::Final);
        }
        let reason = format!("answers with status {status}{}", said(&content));
        Err(if status.as_u16() == 429 || status.is_server_error() {
            AttemptError::Passing(reason, asked)
        } else {
            AttemptError::Final(reason)
        })
    }

    /// Removes the key from a text: servers repeat keys that they do not know.
    fn without_key(&self, text: &str) -> String {
        match self.key {
            Some(Key(key)) => text.replace(key.as_str(), "(the key)"),
            None => text.to_owned(),
        }
    }
}

/// Configures encryption by the certificates of this machine.
fn tls() -> Result<TlsConfig, String> {
    let found = rustls_native_certs::load_native_certs();
    if found.certs.is_empty() {
        return Err("this machine has no certificates to know https:// servers by".to_owned());
    }
    let certificates: Vec<Certificate<'static>> = found
        .certs
        .iter()
        .map(|certificate| Certificate::from_der(certificate).to_owned())
        .collect();
    Ok(TlsConfig::builder()
        .root_certs(RootCerts::new_with_certs(&certificates))
        .unversioned_rustls_crypto_provider(Arc::new(rustls::crypto::ring::default_provider()))
        .build())
}

fn of_transport(error: &ureq::Error, timeout: Duration) -> AttemptError {
    match error {
        ureq::Error::Timeout(_) => {
            let reason = format!("does not answer within {} s", timeout.as_secs_f64());
            AttemptError::Passing(reason, None)
        }
        ureq::Error::BodyExceedsLimit(_) => {
            AttemptError::Final(format!("answers more than {MOST_ANSWER_BYTES} bytes"))
        }
        ureq::Error::Io(_) | ureq::Error::ConnectionFailed | ureq::Error::HostNotFound => {
            AttemptError::Passing(format!("cannot be reached: {error}"), None)
        }
        other => AttemptError::Final(format!("cannot be asked: {other}")),
    }
}

fn seconds_asked_for<T>(response: &Response<T>) -> Option<Duration> {
    let header = response.headers().get("retry-after")?;
    let seconds: f64 = header.to_str().ok()?.trim().parse().ok()?;
    Duration::try_from_secs_f64(seconds).ok()
}

/// Returns the caption in an answer.
fn caption(content: &[u8]) -> Result<String, String> {
    let answer: Answer = serde_json::from_slice(content)
        .map_err(|error| format!("its answer must be a chat completion: {error}"))?;
    let choice = answer.choices.into_iter().next();
    let choice = choice.ok_or("its answer has no choices")?;
    if choice.finish_reason.as_deref() == Some("length") {
        return Err("it ran out of room before its caption ended".to_owned());
    }
    let text = choice.message.content.unwrap_or_default();
    let words: Vec<&str> = text.split_whitespace().collect();
    let text = words.join(" ");
    if text.is_empty() {
        return Err("its answer holds no text".to_owned());
    }
    if text.chars().count() > MOST_CAPTION_CHARACTERS {
        return Err(format!(
            "its caption has more than {MOST_CAPTION_CHARACTERS} characters"
        ));
    }
    Ok(text)
}

/// Returns the error text of a refusal, on one line.
fn said(content: &[u8]) -> String {
    let text = match serde_json::from_slice::<Refusal>(content) {
        Ok(Refusal { error }) => match error {
            RefusalReason::Object { message } | RefusalReason::Text(message) => message,
        },
        Err(_) => String::from_utf8_lossy(content).into_owned(),
    };
    let words: Vec<&str> = text.split_whitespace().collect();
    let line: String = words.join(" ").chars().take(SHOWN_CHARACTERS).collect();
    match line.is_empty() {
        true => String::new(),
        false => format!(": {line}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_completed_and_such_with_keys_refused() {
        let endpoint = |text: &str| text.parse::<Endpoint>();
        for (text, url) in [
            (
                "http://localhost:8000/v1",
                "http://localhost:8000/v1/chat/completions",
            ),
            (
                "https://lab.example/v1/",
                "https://lab.example/v1/chat/completions",
            ),
            (
                "https://lab.example/x/chat/completions",
                "https://lab.example/x/chat/completions",
            ),
        ] {
            assert_eq!(endpoint(text).map(|e| e.to_string()), Ok(url.to_owned()));
        }
        for text in [
            "localhost:8000",
            "file:///etc/passwd",
            "https://key@lab.example/v1",
            "https://lab.example/v1?key=1",
            "http://",
            "",
        ] {
            assert!(endpoint(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_key_is_not_shown_and_not_sent_in_the_open() {
        let key = Key::new(" sk-secret\n").expect("a key");
        assert_eq!(format!("{key:?}"), "Key(hidden)");
        assert!(Key::new("two words").is_err() && Key::new("").is_err());
        let open = |text: &str| {
            let endpoint: Endpoint = text.parse().expect("an address");
            ChatClient::new(&endpoint, Some(&key), RetryPolicy::default()).is_ok()
        };
        assert!(!open("http://gpu-node:8000/v1"));
        assert!(open("http://127.0.0.1:8000/v1") && open("http://[::1]:8000/v1"));
    }
}
