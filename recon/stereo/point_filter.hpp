#pragma once

#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// Moves the points of a frame along their rays towards the surface that their neighbours show, as far as
// their standard deviations explain the difference, after Lee 1980 (Digital image enhancement and noise
// filtering by use of local statistics, IEEE PAMI 2(2), section II). Neighbours share an edge of
// `result.triangles`. Changes points and covariances; pixels stay as matched.
//
// Inverse depth is linear in the image on a plane. The plane through a point's neighbours, weighted by their
// variances, predicts it with a variance v. What the differences from such predictions have beyond v and the
// points' own variances s^2, over the point, its neighbours and theirs, is the ground's own relief, r^2.
// Point and prediction are combined by their variances, s^2 and v + r^2: on smooth ground a fifth of the
// variance remains, on ground rougher than the noise all of it. Points more than three standard deviations
// from the prediction, as at a step, stay; so do those with fewer than four neighbours.
//
// The errors of neighbours are then alike; their standard deviations are right each for itself. Linear in the
// number of points.
void smoothPoints(StereoResult& result);

}  // namespace fathom::stereo
