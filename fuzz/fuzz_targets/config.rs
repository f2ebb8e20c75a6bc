//! Any text as a solver config: an error or a config, never a panic.
#![no_main]

use gensim2_kpam::SolverConfig;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(config) = SolverConfig::from_json(text) {
        let _ = config.clock(0.0);
    }
});
