//! Emboss, the program: everything it does is in the library's [`cli`](emboss::cli).

fn main() -> std::process::ExitCode {
    emboss::cli::run()
}
