//! An asset's page and levels from a server on this machine alone.
//!
//! It answers GET and HEAD for the page and the files that the asset's record names, and nothing else.

use std::{
    fs::File,
    io::{self, BufRead, BufReader, Read, Write},
    net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream},
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

use omnilife_schemas::{
    layout::ASSET_FILE,
    records::Asset,
    store::{self, StoreError},
};

use super::PAGE_FILE;
use crate::error::ReconstructError;

/// Bytes of a request's head at most.
const LONGEST_HEAD: u64 = 16 * 1024;
/// How long a client may take to send its request.
const PATIENCE: Duration = Duration::from_secs(10);

/// A server that is listening.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    folder: PathBuf,
    files: Vec<String>,
}

impl Server {
    /// Listens on a port of 127.0.0.1; port 0 takes a free one.
    ///
    /// # Errors
    /// When the folder has no asset with a page, or the port is taken.
    pub fn listen(folder: &Path, port: u16) -> Result<Self, ReconstructError> {
        let path = folder.join(ASSET_FILE);
        let asset: Asset = store::read_record(&path)?;
        if asset.page.is_none() {
            return Err(StoreError::malformed(
                &path,
                "has no page; export it anew with --page".to_owned(),
            )
            .into());
        }
        let splats = asset.splat_files().map(str::to_owned);
        let files = splats.chain([PAGE_FILE.to_owned(), ASSET_FILE.to_owned()]);
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        let listener = TcpListener::bind(address).map_err(|error| ReconstructError::Request {
            reason: format!("{address}: cannot be listened on: {error}"),
        })?;
        Ok(Self {
            listener,
            folder: folder.to_owned(),
            files: files.collect(),
        })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// When the system does not say.
    pub fn address(&self) -> Result<SocketAddr, ReconstructError> {
        self.listener
            .local_addr()
            .map_err(|error| ReconstructError::Request {
                reason: format!("no address to serve from: {error}"),
            })
    }

    /// Answers until the process ends. A client that fails is no reason to stop.
    pub fn run(&self) {
        thread::scope(|scope| {
            for stream in self.listener.incoming().flatten() {
                scope.spawn(move || {
                    // What cannot be told to the client that left can be told to nobody.
                    let _ = self.answer(stream);
                });
            }
        });
    }

    fn answer(&self, mut stream: TcpStream) -> io::Result<()> {
        stream.set_read_timeout(Some(PATIENCE))?;
        let mut line = String::new();
        let mut reader = BufReader::new(stream.try_clone()?.take(LONGEST_HEAD));
        reader.read_line(&mut line)?;
        let mut header = String::new();
        while reader.read_line(&mut header)? > 2 {
            header.clear();
        }
        let mut words = line.split_whitespace();
        let (method, target) = (words.next().unwrap_or(""), words.next().unwrap_or(""));
        if method != "GET" && method != "HEAD" {
            return refuse(&mut stream, "405 Method Not Allowed");
        }
        let name = target.split(['?', '#']).next().unwrap_or("");
        let name = match name.strip_prefix('/') {
            Some("") => PAGE_FILE,
            Some(name) => name,
            None => "",
        };
        // A name of the record, not a path: nothing outside of the asset can be asked for.
        let Some(file) = self.files.iter().find(|file| *file == name) else {
            return refuse(&mut stream, "404 Not Found");
        };
        let Ok(mut content) = File::open(self.folder.join(file)) else {
            return refuse(&mut stream, "404 Not Found");
        };
        let kind = match Path::new(file).extension().and_then(|kind| kind.to_str()) {
            Some("html") => "text/html; charset=utf-8",
            Some("json") => "application/json",
            _ => "application/octet-stream",
        };
        write!(
            stream,
            "HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nX-Content-Type-Options: \
             nosniff\r\nConnection: close\r\n\r\n",
            content.metadata()?.len()
        )?;
        if method == "GET" {
            io::copy(&mut content, &mut stream)?;
        }
        stream.flush()
    }
}

fn refuse(stream: &mut TcpStream, status: &str) -> io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
    )
}
