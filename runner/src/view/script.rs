//! A user made of lines: inputs and waits, for tests and for the picture of the viewer in the README.
//!
//! One step a line; empty lines and those that begin with `#` are nothing:
//!
//! | Line | Step |
//! |---|---|
//! | `key NAME`, `hold NAME`, `release NAME` | a key is tapped, goes down, comes up |
//! | `drag X Y` | the pointer is dragged by so many pixels |
//! | `click`, `wheel NOTCHES`, `move X Y` | the button is clicked, the wheel turned, the captured mouse moved |
//! | `size WIDTH HEIGHT` | the window is asked to have another size |
//! | `density FACTOR` | waits until the window is on a screen of that density |
//! | `samples COUNT` | waits until that many samples of what was asked for are seen |
//! | `frames COUNT` | waits until that many more pictures of the model have been shown |
//! | `message TEXT` | waits until the panel's message begins so |
//! | `say TEXT` | prints a line with how many samples are seen, so that whoever runs the script knows where it is |
//! | `answers TEXT` | prints how promptly the window answered since that was printed last, and pictures were shown |
//! | `renew` | makes anew what shows pictures, as where the window's system has taken it back |
//! | `grab FILE` | saves what the window shows, the panel with it, as a PNG |
//! | `quit` | closes the window |

use super::input::{Input, key_named};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};

/// Steps that are still to be done.
#[derive(Clone, Debug, PartialEq)]
pub struct Script(VecDeque<Step>);

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Step {
    Inputs(Vec<Input>),
    Size(u32, u32),
    Density(f64),
    Samples(u32),
    Frames(u32),
    Message(String),
    Say(String),
    Answers(String),
    Renew,
    Grab(PathBuf),
    Quit,
}

/// A script cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScriptError {
    /// Its file cannot be read.
    #[error("{}: the script cannot be read ({reason})", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: std::io::Error,
    },
    /// A line is no step.
    #[error("{}:{line}: `{text}` is no step of a script; write one such as `key p` or `samples 4`", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
}

impl Script {
    /// Reads a script.
    ///
    /// # Errors
    /// [`ScriptError`].
    pub fn read(path: &Path) -> Result<Script, ScriptError> {
        let unreadable = |reason| ScriptError::Unreadable { path: path.to_owned(), reason };
        let text = std::fs::read_to_string(path).map_err(unreadable)?;
        let mut steps = VecDeque::new();
        for (line, text) in (1..).zip(text.lines().map(str::trim)) {
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let unknown = || ScriptError::Unknown { path: path.to_owned(), line, text: text.to_owned() };
            steps.push_back(step(text).ok_or_else(unknown)?);
        }
        Ok(Script(steps))
    }

    /// The step that is to be done next.
    pub(super) fn next(&mut self) -> Option<&mut Step> {
        self.0.front_mut()
    }

    /// Whether no step is left.
    pub(super) fn is_done(&self) -> bool {
        self.0.is_empty()
    }

    /// The next step is done.
    pub(super) fn advance(&mut self) {
        self.0.pop_front();
    }
}

fn step(text: &str) -> Option<Step> {
    let (word, rest) = text.split_once(' ').unwrap_or((text, ""));
    let numbers = || rest.split_whitespace().map(str::parse::<f64>).collect::<Result<Vec<_>, _>>().ok();
    let two = || numbers().and_then(|numbers| <[f64; 2]>::try_from(numbers).ok());
    let key = |is_down| key_named(rest).map(|key| Input::Key { key, is_down, is_repeat: false });
    Some(match word {
        "key" => Step::Inputs(vec![key(true)?, key(false)?]),
        "hold" => Step::Inputs(vec![key(true)?]),
        "release" => Step::Inputs(vec![key(false)?]),
        "click" => Step::Inputs(vec![Input::Button { is_down: true }, Input::Button { is_down: false }]),
        "drag" => {
            let [x, y] = two()?;
            Step::Inputs(vec![
                Input::Pointer { x: 0.0, y: 0.0 },
                Input::Button { is_down: true },
                Input::Pointer { x, y },
                Input::Button { is_down: false },
            ])
        }
        "move" => {
            let [x, y] = two()?;
            Step::Inputs(vec![Input::Motion { x, y }])
        }
        "wheel" => Step::Inputs(vec![Input::Wheel { notches: rest.parse().ok()? }]),
        "size" => {
            let (width, height) = rest.split_once(' ')?;
            Step::Size(width.parse().ok()?, height.parse().ok()?)
        }
        "density" => Step::Density(rest.parse().ok()?),
        "samples" => Step::Samples(rest.parse().ok()?),
        "frames" => Step::Frames(rest.parse().ok()?),
        "message" => Step::Message(rest.to_owned()),
        "say" => Step::Say(rest.to_owned()),
        "answers" => Step::Answers(rest.to_owned()),
        "renew" => Step::Renew,
        "grab" => Step::Grab(rest.into()),
        "quit" => Step::Quit,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use winit::keyboard::KeyCode;

    fn read(text: &str) -> Result<Script, ScriptError> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("writable");
        Script::read(file.path())
    }

    #[test]
    fn lines_are_steps() {
        let mut script = read("# a comment\n\nhold w\nsize 3 4\nsamples 2\nsay a b\nquit\n").expect("sound");
        let held = Input::Key { key: KeyCode::KeyW, is_down: true, is_repeat: false };
        for expected in [
            Step::Inputs(vec![held]),
            Step::Size(3, 4),
            Step::Samples(2),
            Step::Say("a b".to_owned()),
            Step::Quit,
        ] {
            assert_eq!(script.next(), Some(&mut expected.clone()));
            script.advance();
        }
        assert_eq!(script.next(), None);
    }

    #[test]
    fn wrong_lines_are_named() {
        for wrong in ["key nothing", "drag 1", "samples x", "dance", "wheel", "size 3"] {
            let error = read(&format!("quit\n{wrong}")).expect_err(wrong).to_string();
            assert!(error.contains(&format!(":2: `{wrong}` is no step")), "{error}");
        }
        assert!(Script::read(Path::new("no-such-file")).is_err());
    }
}
