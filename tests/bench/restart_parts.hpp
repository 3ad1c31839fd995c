#pragma once

namespace fathom::bench {

// Size of the saved state and the times to save and to load it, of the two parts that grow with a mission, at
// the end of one of five hours: a map whose pool is full with 36,000 meshes, and a graph of 20,000 keyframes.
// Prints a table; 0 when what was loaded is the same.
int reportRestartParts();

}  // namespace fathom::bench
