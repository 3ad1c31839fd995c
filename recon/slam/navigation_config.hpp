#pragma once

#include "realtime/kernel/config_table.hpp"
#include "recon/slam/navigation_graph.hpp"

namespace fathom::slam {

// Reads the keys of a [sensors] table, the errors of the navigation sensors (README.md lists them with units
// and ranges), over `defaults`. The same on board and topside. Throws InputError; keys that it does not know
// are left for the caller's finish().
[[nodiscard]] SensorNoise readSensorNoise(const ConfigTable& table, const SensorNoise& defaults);

// The same where nobody predicts the tide: the sea's height over nav's zero is unknown by half a metre, as a
// tide of 0.7 m leaves it. Topside, which claims heights: on board nobody is shown any such claim.
[[nodiscard]] SensorNoise withoutTideModel(SensorNoise noise);

}  // namespace fathom::slam
