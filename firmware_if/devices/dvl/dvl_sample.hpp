#pragma once

#include <optional>

#include "firmware_if/devices/dvl/pd0_ensemble.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// The ensemble as navigation takes it: the instrument's own velocity over the ground (PD0 sends the bottom's)
// in the DVL frame, forward (beam 3), starboard (beam 2), down. std::nullopt without a valid time or
// bottom-track block. Velocity, altitude and each range may be absent.
//
// Frames, from "ADCP Coordinate Transformation" (TRDI P/N 951-6079-00):
//   beam        X = (b1 - b2) / (2 sin a), Y = (b4 - b3) / (2 sin a), Z = (b1 + b2 + b3 + b4) / (4 cos a),
//               from all four beams;
//   instrument  X starboard, Y forward, Z up, without the heading alignment EA (T_body_dvl holds it);
//   ship        starboard, forward, mast: fixed to the vehicle. Tilts do not level them: on a real AUV dive
//               with the tilt bit set, only the mast-frame reading agrees with the rate of change of
//               altitude;
//   earth       east, north, up, turned back by the ensemble's heading, pitch and roll.
// The orientation bit is of the water profile: a vehicle with an upper and a lower head (a REMUS) alternates
// it while both kinds of ensemble carry the lower head's bottom track. In beam and instrument frame, where
// the bit would change the meaning of the axes, velocity of an up-looking ensemble is absent. Altitude: over
// a flat bottom the reciprocals of opposite beams' ranges add up to 2 cos(tilt) / altitude, so it is their
// harmonic mean times the cosine of the tilt, averaged over the whole ones of the pairs (1, 2) and (3, 4).
[[nodiscard]] std::optional<DvlSample> toDvlSample(const Pd0Ensemble& ensemble);

}  // namespace fathom::io
