//! Writer of results on a separate thread, in parallel to the simulation.
//!
//! Contract: the file is that of [`ResultsWriter`]; at most `frames` frames wait in memory, then the
//! simulation waits; the first error stops writing and is returned by the next call.

use super::{FrameData, ResultsWriter};
use crate::error::{Error, Result};
use ballast::model::Model;
use ballast::state::State;
use ballast::workspace::Workspace;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

enum WriterCommand {
    Frame(Box<FrameData>),
    Series(String, Vec<(String, String)>),
    Row(String, u64, Vec<f64>),
    Secure(SyncSender<()>),
}

/// A [`ResultsWriter`] on a separate thread.
#[derive(Debug)]
pub struct BackgroundWriter {
    path: PathBuf,
    /// Channel to the thread; `None` after the end of writing.
    sender: Option<SyncSender<WriterCommand>>,
    thread: Option<JoinHandle<Result<()>>>,
}

impl BackgroundWriter {
    /// Moves `writer` to a thread with a queue of `waiting` frames and rows, at least one.
    pub fn new(writer: ResultsWriter, waiting: usize) -> Self {
        let path = writer.path().to_path_buf();
        let (sender, receiver) = sync_channel(waiting.max(1));
        let thread = std::thread::spawn(move || serve(writer, receiver));
        Self { path, sender: Some(sender), thread: Some(thread) }
    }

    /// Collects and queues a frame; see [`ResultsWriter::frame`].
    pub fn frame(&mut self, model: &Model, state: &State, workspace: &Workspace) -> Result<()> {
        self.send(WriterCommand::Frame(Box::new(FrameData::take(model, state, workspace))))
    }

    /// Queues the declaration of a table; see [`ResultsWriter::table`].
    pub fn table(&mut self, name: &str, columns: &[(&str, &str)]) -> Result<()> {
        let columns = columns.iter().map(|(n, u)| (n.to_string(), u.to_string())).collect();
        self.send(WriterCommand::Series(name.into(), columns))
    }

    /// Queues a row; see [`ResultsWriter::append`].
    pub fn append(&mut self, name: &str, step: u64, row: &[f64]) -> Result<()> {
        self.send(WriterCommand::Row(name.into(), step, row.to_vec()))
    }

    /// Waits for [`ResultsWriter::secure`].
    pub fn secure(&mut self) -> Result<()> {
        let (done, wait) = sync_channel(1);
        self.send(WriterCommand::Secure(done))?;
        match wait.recv() {
            Ok(()) => Ok(()),
            Err(_) => Err(self.end()),
        }
    }

    /// Writes the queue, completes the file, and returns the first error, if any.
    pub fn close(mut self) -> Result<()> {
        self.sender = None;
        self.join()
    }

    fn send(&mut self, message: WriterCommand) -> Result<()> {
        let sent = self.sender.as_ref().is_some_and(|sender| sender.send(message).is_ok());
        if sent { Ok(()) } else { Err(self.end()) }
    }

    /// Returns the error with which the thread ended.
    fn end(&mut self) -> Error {
        self.sender = None;
        match self.join() {
            Err(error) => error,
            Ok(()) => Error::WriterGone { path: self.path.clone() },
        }
    }

    fn join(&mut self) -> Result<()> {
        let gone = || Error::WriterGone { path: self.path.clone() };
        self.thread.take().ok_or_else(gone)?.join().unwrap_or_else(|_| Err(gone()))
    }
}

impl Drop for BackgroundWriter {
    /// Writes the queue, also when an error elsewhere ends the run.
    fn drop(&mut self) {
        self.sender = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn serve(mut writer: ResultsWriter, receiver: Receiver<WriterCommand>) -> Result<()> {
    for message in receiver {
        match message {
            WriterCommand::Frame(frame) => writer.write(&frame)?,
            WriterCommand::Series(name, columns) => {
                let columns: Vec<_> = columns.iter().map(|(n, u)| (&n[..], &u[..])).collect();
                writer.table(&name, &columns)?;
            }
            WriterCommand::Row(name, step, row) => writer.append(&name, step, &row)?,
            WriterCommand::Secure(done) => {
                writer.secure()?;
                // The receiver may be gone.
                let _ = done.send(());
            }
        }
    }
    writer.close()
}
