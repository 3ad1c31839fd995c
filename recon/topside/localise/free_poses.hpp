#pragma once

#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/localise/slam_stage.hpp"

namespace fathom::topside {

// Poses of a dive from its images: visual odometry between consecutive pairs (over one that shows too little,
// if need be; where there are no features, from all pixels of level ground, alignGround(); where there is
// nothing to see, by velocities and attitudes), places recognised (closure::PlaceIndex, closure::Agreement),
// pairs that overlap by the poses found so far; maximum likelihood of all, closures that contradict the
// others taken out. Where nothing joins pairs, the dive falls into parts (SlamResult::parts), the first
// pair's first. What files of navigation know (Survey::known) places and levels them (KnownPlaces); without,
// a part is level on the seafloor that it shows, with its first camera at depth 0 and the top of that image
// to the north, and stands east of the part before it. The result does not depend on the number of threads.
[[nodiscard]] SlamResult localiseFreely(const MissionInput& input, const TopsideConfig& config,
                                        const Survey& survey, const FeatureStore& features,
                                        const GreyImages& images);

}  // namespace fathom::topside
