#pragma once

#include "realtime/kernel/config_table.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// Reads the keys of a [stereo] table over `defaults`; every program that has one uses this, so that the keys
// (README.md lists them with units and ranges) mean the same on board and topside. Throws InputError; keys
// that it does not know are left for the caller's finish().
[[nodiscard]] SparseStereoConfig readSparseStereoConfig(const ConfigTable& table,
                                                        const SparseStereoConfig& defaults);

}  // namespace fathom::stereo
