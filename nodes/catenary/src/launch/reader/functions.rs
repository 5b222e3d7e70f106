//! Functions of substitutions: `var`, `env`, `dirname`, `find-pkg-share` and so on.

use super::package;
use super::scope::Scope;
use std::path::Path;

/// Supported substitutions, for messages.
const KNOWN: &str = "var NAME [DEFAULT], env NAME [DEFAULT], dirname, filename, find-pkg-share PACKAGE, find-pkg-prefix PACKAGE, \
                     exec-in-pkg PROGRAM PACKAGE, find-exec PROGRAM, not A, and A B, or A B, equals A B, not-equals A B, if A B [C]";

/// Value of `$(name arguments...)`. Returns the reason as text if it has none.
pub fn call(name: &str, arguments: &[String], scope: &Scope<'_>) -> Result<String, String> {
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let environment = scope.environment;
    let path = |path: std::path::PathBuf| path.display().to_string();
    match (name, &arguments[..]) {
        ("var", [name, default @ ..]) if default.len() < 2 => {
            let value = scope.variables.get(*name).cloned().or_else(|| default.first().map(|d| (*d).to_owned()));
            value.ok_or_else(|| format!("no argument or variable `{name}`"))
        }
        ("env", [name, default @ ..]) if default.len() < 2 => {
            let value = environment(name).or_else(|| default.first().map(|d| (*d).to_owned()));
            value.ok_or_else(|| "the environment variable is not set and there is no default".to_owned())
        }
        ("dirname", []) => place(scope, Path::parent),
        ("filename", []) => place(scope, |file| Some(file)),
        ("find-pkg-prefix", [package]) => package::prefix(package, environment).map(path),
        ("find-pkg-share", [package]) => package::share(package, environment).map(path),
        ("exec-in-pkg", [program, package]) => package::executable(program, package, environment).map(path),
        ("find-exec", [program]) => package::program(program, environment).map(path),
        ("not", [a]) => Ok((!boolean(a)?).to_string()),
        // No short circuit: an invalid second operand is an error, as in ROS 2.
        ("and", [a, b]) => Ok((boolean(a)? & boolean(b)?).to_string()),
        ("or", [a, b]) => Ok((boolean(a)? | boolean(b)?).to_string()),
        ("equals", [a, b]) => Ok(equals(a, b).to_string()),
        ("not-equals", [a, b]) => Ok((!equals(a, b)).to_string()),
        ("if", [condition, yes, no @ ..]) if no.len() < 2 => {
            let value = if boolean(condition)? { *yes } else { no.first().copied().unwrap_or_default() };
            Ok(value.to_owned())
        }
        _ => Err(wrong_form(name)),
    }
}

fn wrong_form(name: &str) -> String {
    let takes = match name {
        "dirname" | "filename" => "no argument",
        "not" | "find-pkg-prefix" | "find-pkg-share" | "find-exec" => "1 argument",
        "and" | "or" | "equals" | "not-equals" | "exec-in-pkg" => "2 arguments",
        "var" | "env" => "1 or 2 arguments",
        "if" => "2 or 3 arguments",
        _ => return format!("expected one of {KNOWN}"),
    };
    format!("{name} takes {takes}")
}

/// Part of the launch file's own path. Returns an error where ROS 2's front end would take the path of another file.
fn place(scope: &Scope<'_>, part: impl Fn(&Path) -> Option<&Path>) -> Result<String, String> {
    let own = part(scope.file).unwrap_or(Path::new(""));
    match scope.included.and_then(&part).filter(|other| *other != own) {
        Some(other) => Err(format!(
            "inside and behind an <include>, ROS 2 takes {} for {}; keep it with <let> before the <include>",
            other.display(),
            own.display()
        )),
        None => Ok(own.display().to_string()),
    }
}

/// Boolean in the spelling of YAML 1.1, or 1 or 0.
pub fn boolean(text: &str) -> Result<bool, String> {
    match text {
        "true" | "True" | "TRUE" | "yes" | "Yes" | "YES" | "on" | "On" | "ON" | "1" => Ok(true),
        "false" | "False" | "FALSE" | "no" | "No" | "NO" | "off" | "Off" | "OFF" | "0" => Ok(false),
        other => Err(format!("expected true or false, got `{other}`")),
    }
}

/// Equality as in ROS 2's launch: booleans, then numbers with a relative tolerance of 1e-9, then texts.
fn equals(a: &str, b: &str) -> bool {
    let truth = |text: &str| match text.to_ascii_lowercase().as_str() {
        "true" | "1" => Some(true),
        "false" | "0" => Some(false),
        _ => None,
    };
    if let (Some(a), Some(b)) = (truth(a), truth(b)) {
        return a == b;
    }
    match (a.trim().parse::<f64>(), b.trim().parse::<f64>()) {
        (Ok(a), Ok(b)) => a == b || (a - b).abs() <= 1e-9 * a.abs().max(b.abs()),
        _ => a == b,
    }
}
