#pragma once

#include <vector>

#include "recon/closure/descriptor_matching.hpp"
#include "recon/products/exports/sparse_model.hpp"

namespace fathom::topside {

// Features of two views that are one place.
struct ViewMatches {
  std::uint32_t a = 0, b = 0;  // views
  std::vector<closure::Match> matches;
};

// Fills points, members and every view's point_of from the views' features. Features that matches join are
// one point, unless two of them are of one view: then a match is wrong, and each is a point of its own. A
// point's place is the mean of what its views say, weighted by their covariances; a view in which its pixels
// are more than kMostError from it is left out of it and gets a point of its own.
constexpr double kMostError = 4;  // mean of left and right [px]; COLMAP's own filter for tracks
void joinFeatures(const std::vector<ViewMatches>& links, SparseModel& model);

}  // namespace fathom::topside
