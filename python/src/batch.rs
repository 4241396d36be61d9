//! Batch registration from Python.

use std::ffi::CString;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use numpy::PyArray1;
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde::Deserialize;

use super::cloud_arg::CloudArg;
use super::custom_method::CustomMethod;
use super::errors::{real, settings_error, to_pyerr};
use super::gil::run_interruptible;
use super::interop::BadRows;
use super::registration::{NamedMethod, RegistrationOptions, parse_chain};
use cfreg::batch::{
    self, Batch, Column, Downsampling, PairList, Row, RowGraph, StartMode, Summary,
    install_panic_hook,
};
use cfreg::cloud::ViewpointSource;
use cfreg::error::Error;
use cfreg::method::Pipeline;
use cfreg::par::Interrupt;
use cfreg::pose_graph::Tangent;

/// Settings of a batch run, as passed by the package in JSON.
#[derive(Deserialize)]
struct BatchSettings {
    threads: usize,
    memory: usize,
    time_limit: Option<f64>,
    times: bool,
    viewpoints: ViewpointSource,
    voxel: Option<f64>,
    sample: Option<usize>,
    seed: u64,
    resume: bool,
    overwrite: bool,
    #[serde(flatten)]
    options: RegistrationOptions,
}

impl BatchSettings {
    fn read(json: &str) -> PyResult<BatchSettings> {
        serde_json::from_str(json).map_err(|error| settings_error("settings", error))
    }

    fn apply_to(&self, batch: &mut Batch<'_>) -> cfreg::Result<()> {
        batch.threads = self.threads;
        batch.memory = self.memory;
        batch.times = self.times;
        batch.viewpoints = self.viewpoints;
        batch.keep_no_returns = self.options.keep_no_returns();
        batch.thinning = Downsampling { voxel: self.voxel, sample: self.sample, seed: self.seed };
        batch.start = match (self.resume, self.overwrite) {
            (true, true) => {
                let rule = "contradicts overwrite: choose one of them";
                return Err(Error::config("resume", true, rule));
            }
            (true, false) => StartMode::Resume,
            (false, true) => StartMode::Overwrite,
            (false, false) => StartMode::Fresh,
        };
        if let Some(seconds) = self.time_limit {
            let limit = Duration::try_from_secs_f64(seconds).ok().filter(|limit| !limit.is_zero());
            let refuse =
                || Error::config("time_limit", seconds, "must be a number of seconds above 0");
            batch.time_limit = Some(limit.ok_or_else(refuse)?);
        }
        Ok(())
    }
}

/// The pairs, as given by the caller.
#[derive(FromPyObject)]
pub(super) enum PairsArg {
    /// By their names.
    Names(Vec<(String, String)>),
    /// A file with a list of pairs.
    File(PathBuf),
}

/// Register pairs and return the columns of their rows, {name: (kind, values)}. With an `output`,
/// write the rows, and return the numbers of pairs: all, resumed, trusted, without a pose.
#[pyfunction]
#[pyo3(signature = (pairs, clouds, folder, method, refinements, settings, output=None, progress=None, custom=None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(super) fn register_batch(
    py: Python<'_>,
    pairs: PairsArg,
    clouds: &Bound<'_, PyDict>,
    folder: Option<PathBuf>,
    method: NamedMethod,
    refinements: Vec<NamedMethod>,
    settings: &str,
    output: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
    custom: Option<Py<PyAny>>,
) -> PyResult<Py<PyAny>> {
    let settings = BatchSettings::read(settings)?;
    // The first method of a custom method's chain is the one that verifies; it is not run.
    let verifier = ("consensus".to_string(), "{}".to_string());
    let first = if custom.is_some() { &verifier } else { &method };
    let (first, refinements) = parse_chain(first, &refinements)?;
    let chain = Pipeline::new(first, refinements).map_err(to_pyerr)?;
    let chain = settings.options.apply_to(chain, true)?;
    let custom = custom.map(|object| CustomMethod::new(object, &method, chain.clone()));
    let custom = custom.transpose()?;
    let mut batch = match &custom {
        Some(custom) => Batch::new(custom, custom),
        None => Batch::new(&chain, &chain),
    };
    settings.apply_to(&mut batch).map_err(to_pyerr)?;
    for (name, cloud) in clouds {
        let name: String = name.extract()?;
        let cloud = CloudArg::read(&cloud, &name, None, BadRows::Drop)?.get().clone();
        batch.in_memory.insert(name, Arc::new(cloud));
    }
    let list = run_interruptible(py, || match &pairs {
        PairsArg::Names(names) => {
            let names = names.iter().map(|(source, target)| [source, target]);
            Ok(PairList::new(folder.unwrap_or_default(), names))
        }
        PairsArg::File(path) => {
            let own = path.parent().unwrap_or(Path::new(""));
            PairList::read(path, folder.as_deref().unwrap_or(own))
        }
    })?;
    install_panic_hook();
    let follower = ProgressCallback {
        call: progress,
        interrupt: batch.interrupt.clone(),
        raised: Mutex::default(),
    };
    let found = run_interruptible(py, || match &output {
        Some(output) => {
            let done =
                batch.run_with(&list, output, |done, all| follower.report_progress(done, all))?;
            Ok(BatchOutput::Summary(done))
        }
        None => batch
            .rows(&list, |done, all| follower.report_progress(done, all))
            .map(BatchOutput::Rows),
    });
    if let Some(raised) = follower.take_error() {
        return Err(raised);
    }
    match found? {
        BatchOutput::Rows(rows) => columns(py, &rows, settings.times),
        BatchOutput::Summary(Summary { pairs, resumed, trusted, errors, damaged, .. }) => {
            if damaged > 0 {
                let words = format!(
                    "{damaged} rows of the run that was cut short were changed since, or are of \
                     other pairs: these were registered again"
                );
                PyErr::warn(py, &py.get_type::<PyUserWarning>(), &CString::new(words)?, 2)?;
            }
            Ok((pairs, resumed, trusted, errors).into_pyobject(py)?.into_any().unbind())
        }
    }
}

/// Return the pairs of source and target of a list.
#[pyfunction]
pub(super) fn read_list(py: Python<'_>, path: PathBuf) -> PyResult<Vec<(String, String)>> {
    let list = run_interruptible(py, || PairList::read(&path, Path::new("")))?;
    let pair = |index| {
        let [source, target] = list.pair(index);
        (source.to_string(), target.to_string())
    };
    Ok((0..list.len()).map(pair).collect())
}

/// Return the columns of written results, as `register_batch` does.
#[pyfunction]
pub(super) fn read_batch(py: Python<'_>, path: PathBuf) -> PyResult<Py<PyAny>> {
    let rows = run_interruptible(py, || batch::results::read(&path))?;
    let times = rows.iter().any(|row| row.seconds.is_some());
    columns(py, &rows, times)
}

/// Write a graph of the rows, in JSON Lines; return its numbers of clouds, components and edges,
/// and of poses that are not accepted and that are left out.
#[pyfunction]
pub(super) fn write_g2o(
    py: Python<'_>,
    path: PathBuf,
    rows: &str,
    rotations: &str,
    names: Option<PathBuf>,
) -> PyResult<(usize, usize, usize, usize, usize)> {
    let tangent = match rotations {
        "quaternion" => Tangent::Quaternion,
        "vector" => Tangent::RotationVector,
        other => {
            let rule = "must be quaternion or vector";
            return Err(to_pyerr(Error::config("rotations", other, rule)));
        }
    };
    run_interruptible(py, || {
        let found = RowGraph::new(&batch::results::parse(rows)?)?;
        let RowGraph { graph, not_accepted, skipped, .. } = &found;
        graph.write(&path, tangent)?;
        names.map_or(Ok(()), |names| found.write_names(&names))?;
        Ok((
            graph.names().len(),
            graph.component_count(),
            graph.edge_count(),
            *not_accepted,
            *skipped,
        ))
    })
}

/// Return pairs of each of `count` scans with the scans `steps` before it.
#[pyfunction]
pub(super) fn consecutive(count: usize, steps: Vec<usize>) -> PyResult<Vec<(usize, usize)>> {
    let pairs = batch::sequential_pairs(count, &steps).map_err(to_pyerr)?;
    Ok(pairs.into_iter().map(Into::into).collect())
}

/// Return pairs of positions (N, 3) that are near each other.
#[pyfunction]
pub(super) fn within(
    py: Python<'_>,
    places: Vec<[f64; 3]>,
    #[pyo3(from_py_with = real)] radius: f64,
) -> PyResult<Vec<(usize, usize)>> {
    let pairs = run_interruptible(py, || batch::radius_pairs(&places, radius))?;
    Ok(pairs.into_iter().map(Into::into).collect())
}

/// What came of a list.
enum BatchOutput {
    Rows(Vec<Row>),
    Summary(Summary),
}

/// A function that is told how far it is; what it raises ends the run.
struct ProgressCallback {
    call: Option<Py<PyAny>>,
    interrupt: Interrupt,
    raised: Mutex<Option<PyErr>>,
}

impl ProgressCallback {
    fn report_progress(&self, done: usize, all: usize) {
        let Some(call) = &self.call else { return };
        if let Some(Err(error)) = Python::try_attach(|py| call.call1(py, (done, all))) {
            self.raised.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            self.interrupt.request();
        }
    }

    fn take_error(&self) -> Option<PyErr> {
        self.raised.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Returns {name: (kind, values)}: texts as a list with None, the rest as arrays, with False, -1
/// and NaN for missing values of a row.
fn columns(py: Python<'_>, rows: &[Row], times: bool) -> PyResult<Py<PyAny>> {
    let all = PyDict::new(py);
    for (name, column) in Row::columns(rows, times) {
        match column {
            Column::Text(texts) => all.set_item(name, ("text", PyList::new(py, texts)?))?,
            Column::Flag(flags) => {
                let flags = flags.into_iter().map(|flag| flag.unwrap_or(false));
                all.set_item(name, ("flag", PyArray1::from_iter(py, flags)))?;
            }
            Column::Count(counts) => {
                let counts = counts.into_iter().map(|count| count.unwrap_or(-1));
                all.set_item(name, ("count", PyArray1::from_iter(py, counts)))?;
            }
            Column::Number(numbers) => {
                let numbers = numbers.into_iter().map(|number| number.unwrap_or(f64::NAN));
                all.set_item(name, ("number", PyArray1::from_iter(py, numbers)))?;
            }
        }
    }
    Ok(all.into_any().unbind())
}
