#pragma once

#include <span>

#include "recon/solver/measurements.hpp"

namespace fathom::slam {

// Replaces a retired pose by measurements between its neighbours, with at
// most the information of its own measurements.
//
// The pose p and its neighbours are a star. With two neighbours, eliminating p leaves one measurement between
// them without loss (the Schur complement):
//   T_a_b = T_a_p T_b_p^-1,   information W_a : W_b = (W_a^-1 + W_b^-1)^-1,
// W being informations about p's own perturbation. With more, it leaves one dense quadratic form that couples
// all of them, which pairs cannot express. Then p is first split into one copy for each neighbour but the
// strongest, r; the information of r's measurement is divided among the copies by shares that add up to one,
// and the copies need no longer agree, which can only lose information. Each copy has two neighbours: what is
// left is a tree r - i with the information (share_i W_r) : W_i, at most the exact marginal's (conservative
// as in covariance intersection, Julier & Uhlmann 1997; for graphs Carlevaris-Bianco, Kaess & Eustice 2014).

// Neighbours of a pose that can be retired, at most; the world is one.
inline constexpr int kMostLinks = 32;

// All measurements of a pose and one neighbour.
struct StarLink {
  int neighbour = kWorld;
  SE3 T_neighbour_pose;                     // their best fit
  Matrix6d information = Matrix6d::Zero();  // of its right perturbation (rho, phi)
};

// From measurements that all join `pose` to the same neighbour. `present`: T_neighbour_pose now, from where
// directions that are not measured are taken.
[[nodiscard]] StarLink starLink(std::span<const Measurement* const> measurements, int pose,
                                const SE3& present);

// T_a_b by shares of two links, once the pose between them is gone; `b` is a pose.
[[nodiscard]] RelativePose composed(const StarLink& a, double share_a, const StarLink& b, double share_b);

// Writes the tree that is left of a star; returns the number of measurements, one less than links (none: 0).
// At most one link is the world's.
int retireStar(std::span<const StarLink> links, std::span<RelativePose> result);

}  // namespace fathom::slam
