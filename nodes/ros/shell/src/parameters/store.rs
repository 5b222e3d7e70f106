//! Parameters of one node.

use super::args::ParamOverride;
use super::kinds::{ParamKind, Value};
use super::spec::ParamSpec;
use super::yaml::Yaml;
use catenary_core::spelling::did_you_mean;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use thiserror::Error;

/// Error of declaring a parameter, or of a value given at the start.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum ParamError {
    /// Second declaration.
    #[error("parameter {0}: declared twice")]
    DeclaredTwice(String),
    /// Default outside the limits.
    #[error("parameter {name}: its default: {reason}")]
    BadDefault {
        /// Name of the parameter.
        name: String,
        /// Expected and given value.
        reason: String,
    },
    /// Value from the command line or a file with the wrong type or outside the limits.
    #[error("{origin}: parameter {name}: {reason}")]
    BadOverride {
        /// Origin of the value.
        origin: String,
        /// Name of the parameter.
        name: String,
        /// Expected and given value.
        reason: String,
    },
    /// Value from the command line or a file for an undeclared parameter.
    #[error("{origin}: node {node} has no parameter {name}; it has {known}{hint}")]
    Unknown {
        /// Origin of the value.
        origin: String,
        /// Name of the node.
        node: String,
        /// Given name of the parameter.
        name: String,
        /// Declared names.
        known: String,
        /// Nearest declared name, with a leading separator; empty if none is near.
        hint: String,
    },
}

/// Handle of one parameter. [`Param::get`] is cheap enough for a control loop.
pub struct Param<T: ParamKind> {
    cell: Arc<T::Cell>,
}

impl<T: ParamKind> Clone for Param<T> {
    fn clone(&self) -> Self {
        Self { cell: Arc::clone(&self.cell) }
    }
}

impl<T: ParamKind> Param<T> {
    /// Returns the present value.
    #[must_use]
    pub fn get(&self) -> T {
        T::load(&self.cell)
    }
}

impl<T: ParamKind + fmt::Debug> fmt::Debug for Param<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_tuple("Param").field(&self.get()).finish()
    }
}

/// Change of one parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Name.
    pub name: String,
    /// New value.
    pub value: Value,
}

/// Declared parameter, for `describe_parameters` and `--help`.
#[derive(Clone, Debug)]
pub struct Description {
    /// Name.
    pub name: String,
    /// Present value.
    pub value: Value,
    /// Description and limits.
    pub spec: ParamSpec,
}

/// Present value without its Rust type.
trait Slot: Send + Sync {
    fn value(&self) -> Value;
    /// Converts a value to the parameter's type, or returns the reason why it cannot.
    fn convert(&self, value: &Value) -> Result<Value, String>;
    /// Stores a value returned by `convert`.
    fn set(&self, value: &Value);
}

struct TypedSlot<T: ParamKind> {
    cell: Arc<T::Cell>,
}

impl<T: ParamKind> Slot for TypedSlot<T> {
    fn value(&self) -> Value {
        T::load(&self.cell).to_value()
    }

    fn convert(&self, value: &Value) -> Result<Value, String> {
        T::from_value(value)
            .map(|value| value.to_value())
            .ok_or_else(|| format!("expected {}, got {}", T::WORD, describe(value)))
    }

    fn set(&self, value: &Value) {
        if let Some(value) = T::from_value(value) {
            T::store(&self.cell, value);
        }
    }
}

fn describe(value: &Value) -> String {
    match value {
        Value::NotSet => "nothing".to_owned(),
        Value::Boolean(value) => format!("the boolean {value}"),
        Value::Integer(value) => format!("the integer {value}"),
        Value::Double(value) => format!("the number {value:?}"),
        Value::String(value) => format!("the string {value:?}"),
        other => format!("{other:?}"),
    }
}

struct Entry {
    spec: ParamSpec,
    slot: Box<dyn Slot>,
}

fn is_of_numbers(value: &Yaml) -> bool {
    match value {
        Yaml::List(items) => matches!(items.first(), Some(Yaml::Float(_))),
        value => matches!(value, Yaml::Float(_)),
    }
}

type Listener = Box<dyn Fn(&[Change]) + Send + Sync>;

struct Inner {
    node: String,
    entries: Mutex<BTreeMap<String, Entry>>,
    overrides: Mutex<Vec<(ParamOverride, bool)>>,
    listeners: Mutex<Vec<Listener>>,
    passed_over: Mutex<Vec<String>>,
}

/// Parameters of one node. Clones share them.
#[derive(Clone)]
pub struct Params {
    inner: Arc<Inner>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Params {
    /// Creates a store without parameters. `overrides` are the values for this node from the command line and files.
    pub(crate) fn new(node: impl Into<String>, overrides: impl IntoIterator<Item = ParamOverride>) -> Self {
        let overrides = overrides.into_iter().map(|value| (value, false)).collect();
        Self {
            inner: Arc::new(Inner {
                node: node.into(),
                entries: Mutex::new(BTreeMap::new()),
                overrides: Mutex::new(overrides),
                listeners: Mutex::new(Vec::new()),
                passed_over: Mutex::new(Vec::new()),
            }),
        }
    }

    /// Declares a parameter. Its value is the last one from the command line or a file, or the default.
    ///
    /// # Errors
    /// [`ParamError`]: a second declaration, a value of the wrong type or outside the limits.
    pub fn declare<T: ParamKind>(&self, name: &str, default: T, spec: ParamSpec) -> Result<Param<T>, ParamError> {
        let name = name.to_owned();
        spec.allows(&default.to_value()).map_err(|reason| ParamError::BadDefault { name: name.clone(), reason })?;
        let value = self.override_of(&name, &spec)?.unwrap_or(default);
        let cell = Arc::new(value.into_cell());
        let slot = Box::new(TypedSlot::<T> { cell: Arc::clone(&cell) });
        let mut entries = lock(&self.inner.entries);
        if entries.contains_key(&name) {
            return Err(ParamError::DeclaredTwice(name));
        }
        entries.insert(name, Entry { spec, slot });
        Ok(Param { cell })
    }

    fn override_of<T: ParamKind>(&self, name: &str, spec: &ParamSpec) -> Result<Option<T>, ParamError> {
        let mut overrides = lock(&self.inner.overrides);
        let mut given = None;
        for (value, used) in overrides.iter_mut().filter(|(value, _)| value.name == name) {
            // Every value for this name counts as used, also the ones that a later value replaces.
            *used = true;
            given = Some(&*value);
        }
        let Some(given) = given else { return Ok(None) };
        let (mut value, mut origin) = (&given.value, &given.origin);
        match &given.hidden {
            // ROS 2 keeps the earlier integer and then refuses it for a double. This crate accepts the later double.
            Some((later, place)) if is_of_numbers(later) && T::from_yaml(later).is_some() => {
                (value, origin) = (later, place);
            }
            Some((hidden, place)) => lock(&self.inner.passed_over).push(format!(
                "{origin}: {} counts, as in ROS 2, and not {} of {place}: give values of one type",
                value.describe(),
                hidden.describe()
            )),
            None => {}
        }
        let bad = |reason| ParamError::BadOverride { origin: origin.clone(), name: name.to_owned(), reason };
        let typed =
            T::from_yaml(value).ok_or_else(|| bad(format!("expected {}, got {}", T::WORD, value.describe())))?;
        spec.allows(&typed.to_value()).map_err(bad)?;
        Ok(Some(typed))
    }

    /// Refuses values from the command line or a file for undeclared parameters. Values of a file's wildcard entries are
    /// tolerated; their origins are returned.
    pub(crate) fn refuse_unknown(&self) -> Result<Vec<String>, ParamError> {
        let overrides = lock(&self.inner.overrides);
        let unused = || overrides.iter().filter(|(_, used)| !used).map(|(given, _)| given);
        let Some(unknown) = unused().find(|given| !given.wildcard) else {
            return Ok(unused().map(|given| given.origin.clone()).collect());
        };
        Err(ParamError::Unknown {
            origin: unknown.origin.clone(),
            node: self.inner.node.clone(),
            name: unknown.name.clone(),
            hint: did_you_mean(&unknown.name, self.names().iter().map(String::as_str)),
            known: self.names().join(", "),
        })
    }

    /// Returns warnings about later values that have no effect.
    pub(crate) fn passed_over(&self) -> Vec<String> {
        lock(&self.inner.passed_over).clone()
    }

    /// Registers a listener. It is called with the changes of every accepted set, on the setter's thread.
    pub fn on_change(&self, listener: impl Fn(&[Change]) + Send + Sync + 'static) {
        lock(&self.inner.listeners).push(Box::new(listener));
    }

    /// Drops the listeners, and with them the publishers that they hold.
    pub(crate) fn forget_listeners(&self) {
        lock(&self.inner.listeners).clear();
    }

    /// Returns the names in alphabetical order.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        lock(&self.inner.entries).keys().cloned().collect()
    }

    /// Returns the present value; `None` for an unknown name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<Value> {
        lock(&self.inner.entries).get(name).map(|entry| entry.slot.value())
    }

    /// Returns the description; `None` for an unknown name.
    #[must_use]
    pub fn describe(&self, name: &str) -> Option<Description> {
        lock(&self.inner.entries).get(name).map(|entry| Description {
            name: name.to_owned(),
            value: entry.slot.value(),
            spec: entry.spec.clone(),
        })
    }

    /// Sets one parameter.
    ///
    /// # Errors
    /// Reason, with the expected and the given value.
    pub fn set(&self, name: &str, value: &Value) -> Result<(), String> {
        self.set_all(&[(name.to_owned(), value.clone())])
    }

    /// Sets all parameters or none.
    ///
    /// # Errors
    /// Reason of the first refusal.
    pub fn set_all(&self, values: &[(String, Value)]) -> Result<(), String> {
        let mut changes = Vec::with_capacity(values.len());
        {
            let entries = lock(&self.inner.entries);
            for (name, value) in values {
                let entry =
                    entries.get(name).ok_or_else(|| format!("node {} has no parameter {name}", self.inner.node))?;
                let reason = |reason: String| format!("parameter {name}: {reason}");
                if entry.spec.read_only {
                    return Err(reason("it is read-only".to_owned()));
                }
                let value = entry.slot.convert(value).map_err(reason)?;
                entry.spec.allows(&value).map_err(reason)?;
                changes.push(Change { name: name.clone(), value });
            }
            // Only after every value was checked: all or none.
            for change in &changes {
                if let Some(entry) = entries.get(&change.name) {
                    entry.slot.set(&change.value);
                }
            }
        }
        // Without the lock of the entries, which listeners may read.
        for listener in lock(&self.inner.listeners).iter() {
            listener(&changes);
        }
        Ok(())
    }
}

impl fmt::Debug for Params {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Params").field("names", &self.names()).finish_non_exhaustive()
    }
}
