#pragma once

#include <span>

#include "recon/slam/measurements.hpp"

namespace fathom::slam {

// What is left of a pose when it is retired: measurements between its neighbours, which never say more than
// its own measurements did.
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

// All that a pose's measurements say about one neighbour.
struct StarLink {
  int neighbour = kWorld;
  SE3 T_neighbour_pose;                     // where they are satisfied best
  Matrix6d information = Matrix6d::Zero();  // of its right perturbation (rho, phi)
};

// From measurements that all join `pose` to the same neighbour. `present`: T_neighbour_pose now, from where
// directions that are not measured are taken.
[[nodiscard]] StarLink starLink(std::span<const Measurement* const> measurements, int pose,
                                const SE3& present);

// What shares of two links say about T_a_b once the pose between them is gone; `b` is a pose.
[[nodiscard]] RelativePose composed(const StarLink& a, double share_a, const StarLink& b, double share_b);

// Writes the tree that is left of a star; returns the number of measurements, one less than links (none: 0).
// At most one link is the world's.
int retireStar(std::span<const StarLink> links, std::span<RelativePose> result);

}  // namespace fathom::slam
