//! The command line that makes a picture again.

use super::arguments::{RenderArgs, SAMPLES};
use super::inputs::{MapArgument, ModelArgument};
use super::values::OrDefault;
use crate::backend::select::BackendChoice;
use crate::picture::{PictureFormat, srgb_from_linear};
use crate::settings::{ChannelOrder, Light};
use clap::ValueEnum;
use glam::{DVec3, Vec3};
use std::fmt::Display;
use std::path::Path;

impl RenderArgs {
    /// `emboss render` with these arguments, for a shell. Numbers have all the digits that it takes to get the same
    /// bits.
    pub(super) fn command_line(&self) -> String {
        self.command_line_of("render", Some(&self.output))
    }

    /// The same of another command that takes them, with or without its output.
    pub(super) fn command_line_of(&self, command: &str, output: Option<&Path>) -> String {
        // Every field is named, so that none that comes later is forgotten.
        let RenderArgs {
            model,
            color,
            height,
            zero,
            scale,
            subdivisions,
            output: _,
            depth,
            size,
            samples,
            method,
            normal_map,
            normal_space,
            offset_map,
            subdivide,
            normals,
            weld,
            bounds,
            shade,
            smooth,
            backend,
            device,
            eye,
            target,
            up,
            fov,
            lights,
            shadows,
            no_shadows,
            exaggerate,
            displacement,
            channels,
            wrap,
            filter,
            invert,
            seed,
            // Once it has chosen, method and N say what.
            quality: _,
            // These change no picture.
            stats: _,
            no_cache: _,
            validate: _,
            background,
            ambient,
            quiet: _,
            verbose: _,
        } = self;
        let mut line = Line(vec!["emboss".to_owned(), command.to_owned()]);
        line.positional([
            model.as_ref().and_then(model_word),
            color.as_ref().and_then(map_word),
            height.as_ref().and_then(map_word),
            zero.and_then(given_text),
            scale.and_then(given_text),
            subdivisions.and_then(given_text),
        ]);
        if let Some(output) = output {
            line.0.extend(["--output".to_owned(), path_word(output)]);
        }
        line.option("--depth", depth.map(|depth| if depth == PictureFormat::Png16 { 16 } else { 8 }));
        line.option("--size", size.map(|(width, height)| format!("{width}x{height}")));
        line.option("--samples", Some(samples.unwrap_or(SAMPLES)));
        line.choice("--method", *method);
        if let Some(path) = normal_map {
            line.0.extend(["--normal-map".to_owned(), path_word(path)]);
        }
        line.choice("--normal-space", *normal_space);
        if let Some(path) = offset_map {
            line.0.extend(["--offset-map".to_owned(), path_word(path)]);
        }
        line.option("--subdivide", *subdivide);
        line.choice("--normals", *normals);
        line.choice("--weld", *weld);
        line.option("--bounds", *bounds);
        line.choice("--shade", *shade);
        line.assignment("--smooth", smooth.map(switch_text));
        line.choice("--backend", (*backend != BackendChoice::Auto).then_some(*backend));
        line.assignment("--device", device.as_ref().filter(|device| device.starts_with('-')));
        line.text("--device", device.as_deref().filter(|device| !device.starts_with('-')));
        line.assignment("--eye", eye.map(point_text));
        line.assignment("--target", target.map(point_text));
        line.assignment("--up", up.map(point_text));
        line.option("--fov", *fov);
        for light in lights {
            line.assignment("--light", Some(light_text(light)));
        }
        line.option("--shadows", shadows.map(switch_text));
        line.flag("--no-shadows", *no_shadows);
        line.assignment("--exaggerate", *exaggerate);
        line.choice("--displacement", *displacement);
        line.assignment("--channels", channels.map(channels_text));
        line.choice("--wrap", *wrap);
        line.choice("--filter", *filter);
        line.flag("--invert", *invert);
        line.option("--seed", *seed);
        let code = |linear: Vec3| vector_text(Vec3::from(linear.to_array().map(srgb_from_linear)));
        line.assignment("--background", background.map(code));
        line.option("--ambient", *ambient);
        line.0.join(" ")
    }
}

/// The words of a command line, quoted.
struct Line(Vec<String>);

impl Line {
    /// Arguments in their order, quoted; what is left out before one that is given is `-`.
    fn positional(&mut self, words: [Option<String>; 6]) {
        let given = words.iter().rposition(Option::is_some).map_or(0, |last| last + 1);
        self.0.extend(words.into_iter().take(given).map(|word| word.unwrap_or_else(|| "-".to_owned())));
    }

    fn option(&mut self, name: &str, value: Option<impl Display>) {
        self.text(name, value.map(|value| value.to_string()).as_deref());
    }

    fn text(&mut self, name: &str, value: Option<&str>) {
        self.0.extend(value.into_iter().flat_map(|value| [name.to_owned(), quoted(value)]));
    }

    /// An option whose value may begin with a minus, or be left out.
    fn assignment(&mut self, name: &str, value: Option<impl Display>) {
        self.0.extend(value.map(|value| quoted(&format!("{name}={value}"))));
    }

    fn choice(&mut self, name: &str, value: Option<impl ValueEnum>) {
        let named = value.as_ref().and_then(ValueEnum::to_possible_value);
        self.text(name, named.as_ref().map(|value| value.get_name()));
    }

    fn flag(&mut self, name: &str, is_set: bool) {
        self.0.extend(is_set.then(|| name.to_owned()));
    }
}

/// A word as a POSIX shell takes it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:,=+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

/// A path as a shell takes it, and after it this program: one that begins with a minus is no option. Of one that is not
/// UTF-8 the bytes are named, which most shells but not all of them know.
fn path_word(path: &Path) -> String {
    let bytes = path.as_os_str().as_encoded_bytes();
    let is_marked = bytes.starts_with(b"-");
    let mark = if is_marked { "./" } else { "" };
    if let Some(text) = path.to_str() {
        return quoted(&format!("{mark}{text}"));
    }
    let letter = |&byte: &u8| match byte {
        b'\'' | b'\\' => format!("\\{}", char::from(byte)),
        b' '..=b'~' => char::from(byte).to_string(),
        _ => format!("\\x{byte:02x}"),
    };
    format!("$'{mark}{}'", bytes.iter().map(letter).collect::<String>())
}

fn model_word(model: &ModelArgument) -> Option<String> {
    match model {
        ModelArgument::Default => None,
        ModelArgument::Builtin(name) => Some(quoted(name)),
        ModelArgument::File(path) | ModelArgument::Scene(path) => Some(path_word(path)),
    }
}

fn map_word(map: &MapArgument) -> Option<String> {
    match map {
        MapArgument::Default => None,
        MapArgument::None => Some("none".to_owned()),
        MapArgument::File(path) => Some(path_word(path)),
    }
}

fn given_text<T: Display>(value: OrDefault<T>) -> Option<String> {
    value.given().map(|value| value.to_string())
}

fn switch_text(is_on: bool) -> &'static str {
    if is_on { "on" } else { "off" }
}

fn vector_text(Vec3 { x, y, z }: Vec3) -> String {
    format!("{x},{y},{z}")
}

fn point_text(DVec3 { x, y, z }: DVec3) -> String {
    format!("{x},{y},{z}")
}

fn light_text(light: &Light) -> String {
    let mut text = format!("{}:{}", point_text(light.position), vector_text(light.color));
    if let Some(intensity) = light.intensity {
        text += &format!(":{intensity}");
    }
    text
}

fn channels_text(channels: ChannelOrder) -> String {
    match channels {
        ChannelOrder::Blender => "blender".to_owned(),
        ChannelOrder::Mudbox => "mudbox".to_owned(),
        ChannelOrder::Zbrush => "zbrush".to_owned(),
        ChannelOrder::Custom(axes) => axes
            .map(|(channel, negative)| {
                format!("{}{}", if negative { '-' } else { '+' }, ["r", "g", "b"][channel])
            })
            .concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Cli, Command};
    use super::*;
    use clap::Parser;

    fn parsed(words: &[&str]) -> RenderArgs {
        match Cli::try_parse_from(words).expect("valid").command {
            Command::Render(args) => *args,
            _ => panic!("not render"),
        }
    }

    /// Splits what [`quoted`] puts together.
    fn words(line: &str) -> Vec<String> {
        let (mut words, mut word, mut in_quotes, mut letters) = (vec![], String::new(), false, line.chars());
        while let Some(c) = letters.next() {
            match c {
                '\'' => in_quotes = !in_quotes,
                '\\' if !in_quotes => word.extend(letters.next()),
                ' ' if !in_quotes => words.push(std::mem::take(&mut word)),
                c => word.push(c),
            }
        }
        words.push(word);
        words
    }

    /// All options at once, with values that need quotes, signs and digits.
    #[test]
    fn command_line_is_what_it_was_parsed_from() {
        let given = "emboss render it's.obj none - 0.1 -0.3 7 --output a.png --depth 16 --size 3x5 --samples 2 \
             --method grid-walk --normal-map n.png --normal-space world --normals linear --weld off --shade normal \
             --smooth=off --backend cpu \
             --device=4090 --eye=-1,0.3333333333333333,3e-9 --target=412345.125,2,3 --up=0,0,-1 --fov 20.5 \
             --light=-1,2,3:1,0.5,0:7 --light=1,2,3:1,1,1 --shadows off --exaggerate=-1.5 --displacement height \
             --subdivide 2:loop,crease=30 \
             --channels=-r+b+g --wrap mirror --filter trilinear --invert --seed 9 --background=0,1,0 \
             --ambient 0.2";
        let args = parsed(&given.split_whitespace().collect::<Vec<_>>());
        let line = args.command_line();
        let again = parsed(&words(&line).iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(format!("{again:?}"), format!("{args:?}"), "{line}");
        assert!(line.contains(r"'it'\''s.obj'"), "{line}");
    }

    /// A `-x.png` may be the value of --output=, or of an argument after `--`.
    #[test]
    fn paths_with_a_minus_are_no_options() {
        let args = parsed(&["emboss", "render", "--output=-x.png", "--device=-7", "--", "-m.obj"]);
        let line = args.command_line();
        assert_eq!(line, "emboss render ./-m.obj --output ./-x.png --samples 4 --device=-7");
        let again = parsed(&words(&line).iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!((again.output, again.device), ("./-x.png".into(), Some("-7".to_owned())));
    }

    /// A shell takes them back to the bytes that they were.
    #[cfg(unix)]
    #[test]
    fn paths_need_not_be_text() {
        use std::os::unix::ffi::OsStrExt;
        let path = Path::new(std::ffi::OsStr::from_bytes(b"-it's \\n\xff$9.obj"));
        let word = path_word(path);
        let output = std::process::Command::new("bash").args(["-c", &format!("printf %s {word}")]).output();
        assert_eq!(output.expect("bash").stdout, b"./-it's \\n\xff$9.obj", "{word}");
    }

    #[test]
    fn what_was_left_out_stays_out() {
        let line = parsed(&["emboss", "render", "-", "-", "a b.png"]).command_line();
        assert_eq!(line, "emboss render - - 'a b.png' --output emboss.png --samples 4");
    }
}
