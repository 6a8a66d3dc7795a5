//! Exhausted memory: one line and exit code 1 instead of an abort.
//!
//! Half-written files stay under their hidden names, and the next run into the folder removes them, as after a kill.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
    io::{self, Cursor, Write},
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

use omnilife_schemas::{error_kind::last_file, plain_text::for_terminal};

/// Allocator of the system that ends the process where no memory is left.
struct EndingAllocator;

#[global_allocator]
static ALLOCATOR: EndingAllocator = EndingAllocator;

// SAFETY: every call is passed unchanged to the system's allocator, and every returned pointer is that allocator's.
unsafe impl GlobalAlloc for EndingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract.
        or_end(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract.
        or_end(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        // SAFETY: the caller keeps the contract.
        or_end(unsafe { System.realloc(pointer, layout, bytes) }, bytes)
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract.
        unsafe { System.dealloc(pointer, layout) }
    }
}

fn or_end(pointer: *mut u8, bytes: usize) -> *mut u8 {
    if pointer.is_null() {
        end(bytes);
    }
    pointer
}

/// True while some thread reports.
static TOLD: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// True on the thread that reports.
    static TELLS: Cell<bool> = const { Cell::new(false) };
}

#[cold]
fn end(bytes: usize) -> ! {
    if TELLS.replace(true) {
        // Not even enough memory is left for the file's name below.
        drop(io::stderr().write_all(b"omnilife: there is not enough memory\n"));
        at_once();
    }
    if TOLD.swap(true, Ordering::SeqCst) {
        // Another thread has a line to write first.
        thread::sleep(Duration::from_secs(1));
        at_once();
    }
    let mut line = [0; 1024];
    let mut text = Cursor::new(&mut line[..]);
    let _ = write!(
        text,
        "omnilife: there is not enough memory: {bytes} bytes more are needed"
    );
    if let Some(file) = last_file() {
        let file = file.display().to_string();
        // A name that is too long is cut off.
        let _ = write!(text, "; {} was read last", for_terminal(&file));
    }
    let _ = writeln!(text);
    let length = text.position() as usize;
    // With stderr closed the line cannot be written.
    drop(io::stderr().write_all(line.get(..length).unwrap_or_default()));
    at_once();
}

/// Ends the process without running any further code of it.
fn at_once() -> ! {
    #[cfg(unix)]
    // SAFETY: `_exit` takes any number and does not return.
    unsafe {
        nix::libc::_exit(1)
    }
    #[cfg(not(unix))]
    std::process::exit(1)
}
