#include "recon/stereo/sparse_stereo.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>

#include "recon/stereo/gray_pyramid.hpp"
#include "recon/stereo/local_mesh.hpp"
#include "recon/stereo/match_points.hpp"
#include "recon/stereo/patch_tracker.hpp"
#include "recon/stereo/seed_plane.hpp"

namespace fathom::stereo {
namespace {

constexpr int kSparseLevels = 3;  // of the pyramids: the coarsest is a quarter of the size
constexpr double kTopPixel = 1 << (kSparseLevels - 1);  // [px]
// Of the wanted points: with fewer, the ground is blurred, faint, or not where the altitude says.
constexpr double kFewPoints = 0.25, kEnoughPoints = 0.75;
constexpr int kMoreCorners = 4;  // times as many
constexpr int kMaxFeatures = 5000;
constexpr double kHalfPi = 1.5707963267948966;
constexpr int kViewNodes = 24;  // a side, of the lattice that finds what both cameras see

// Of any look.
int mostFeatures(const SparseStereoConfig& c) {
  return c.look_again ? std::min(kMoreCorners * c.max_features, kMaxFeatures) : c.max_features;
}

// Of the window's middle, which must converge to the same position.
int coreWindow(int window) {
  return std::max(PatchTracker::kMinWindow, window / 4 * 2 + 1);
}

void requireSparse(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(std::string("sparse stereo: ") + what);
}

void validate(const StereoRig& rig, const SparseStereoConfig& c) {
  for (const Camera* camera : {&rig.left, &rig.right}) {
    requireSparse(camera->width >= 1 && camera->height >= 1, "the rig has no image size");
    requireSparse(camera->width <= Delaunay::kMaxCoordinate && camera->height <= Delaunay::kMaxCoordinate,
                  "the images are too large");
    requireSparse(camera->fx > 0 && camera->fy > 0, "the rig has no focal length");
  }
  requireSparse(rig.baseline() > 0, "the rig has no baseline");
  requireSparse(c.max_features >= 1 && c.max_features <= kMaxFeatures, "max_features must be 1 to 5000");
  requireSparse(
      c.window >= PatchTracker::kMinWindow && c.window <= PatchTracker::kMaxWindow && c.window % 2 == 1,
      "window must be odd, 7 to 31 px");
  requireSparse(c.max_epipolar_distance > 0, "max_epipolar_distance must be positive");
  requireSparse(c.max_left_right_distance > 0, "max_left_right_distance must be positive");
  requireSparse(c.sigma_scale > 0, "sigma_scale must be positive");
  requireSparse(c.max_core_distance > 0, "max_core_distance must be positive");
  requireSparse(c.max_edge > 0, "max_edge must be positive");
  requireSparse(c.min_range > 0 && c.max_range > c.min_range, "ranges must be 0 < min_range < max_range");
  requireSparse(c.search_radius >= 0 && c.search_radius <= 256, "search_radius must be 0 to 256 px");
  requireSparse(c.min_correlation >= 0 && c.min_correlation < 1, "min_correlation must be 0 to below 1");
  requireSparse(c.max_slope > 0 && c.max_slope < kHalfPi, "max_slope must be between 0 and pi/2");
  requireSparse(c.min_patch_points >= 1, "min_patch_points must be at least 1");
  requireSparse(c.max_fish_length >= 0, "max_fish_length must not be negative");
}

// Limits in pixels of the full size, for matches that are made at a level of the pyramids.
SparseStereoConfig limitsAt(int level, SparseStereoConfig limits) {
  limits.window <<= level;
  for (double* px :
       {&limits.max_epipolar_distance, &limits.max_left_right_distance, &limits.max_core_distance})
    *px *= 1 << level;
  return limits;
}

// The colour of a point, as points are where contrast is strongest and single pixels are noisy: the mean of
// an 8-bit RGB or mono image over a square about a pixel, of a grid of kAcross x kAcross pixels.
constexpr int kAcross = 7;

Rgb colourAbout(const ImageView& image, const Eigen::Vector2f& pixel, int step) {
  const std::size_t channels = image.format == PixelFormat::kRgb ? 3 : 1;
  const auto* bytes = static_cast<const std::uint8_t*>(image.data);
  const auto middle = [](float at, int size) {
    return static_cast<int>(std::lround(std::clamp(at, 0.0F, static_cast<float>(size - 1))));
  };
  const int x = middle(pixel.x(), image.width), y = middle(pixel.y(), image.height), half = kAcross / 2;
  std::array<std::uint32_t, 3> sums{};
  std::uint32_t count = 0;
  for (int j = -half; j <= half; ++j) {
    const int row = y + j * step;
    if (row < 0 || row >= image.height) continue;
    for (int i = -half; i <= half; ++i) {
      const int column = x + i * step;
      if (column < 0 || column >= image.width) continue;
      const std::uint8_t* at =
          bytes + static_cast<std::size_t>(row) * image.stride + static_cast<std::size_t>(column) * channels;
      for (std::size_t c = 0; c < 3; ++c) sums[c] += at[channels == 3 ? c : 0];
      ++count;
    }
  }
  Rgb colour{};
  for (std::size_t c = 0; c < 3; ++c) colour[c] = static_cast<std::uint8_t>((sums[c] + count / 2) / count);
  return colour;
}

// Half of the square that one point represents.
int colourStep(const ImageView& image, std::size_t points) {
  const double spacing = std::sqrt(static_cast<double>(image.width) * image.height /
                                   static_cast<double>(std::max<std::size_t>(points, 1)));
  constexpr int kMost = 5;
  return std::clamp(static_cast<int>(0.5 * spacing / kAcross), 1, kMost);
}

}  // namespace

struct SparseStereo::Impl {
  Impl(const StereoRig& r, const SparseStereoConfig& c, const Kernels& kernels)
      : rig(r),
        config(c),
        wide(wideSearch(r, c.min_range, c.max_range)),
        about_altitude(r, c, c.search_radius),
        anywhere(r, c, wide.search_radius),
        left_pyramid(r.left.width, r.left.height, levels(r), kernels),
        right_pyramid(r.right.width, r.right.height, levels(r), kernels),
        harris(r.left.width, mostFeatures(c), kernels),
        tracker(c.window, kernels),
        core(coreWindow(c.window), kernels),
        found(r, static_cast<std::size_t>(mostFeatures(c))),
        mesh(static_cast<std::size_t>(mostFeatures(c))) {
    const auto most = static_cast<std::size_t>(mostFeatures(c));
    for (StereoResult* each : {&result, &further}) {
      each->matches.reserve(most);
      each->points.reserve(most);
      each->triangles.reserve(2 * most);
    }
    view_rays.resize(static_cast<std::size_t>(kViewNodes) * kViewNodes);
    look();
  }

  // Depends on the rig.
  void look() {
    for (int j = 0; j < kViewNodes; ++j)
      for (int i = 0; i < kViewNodes; ++i)
        view_rays[static_cast<std::size_t>(j * kViewNodes + i)] = rig.left.ray(viewNode(i, j));
    for (Search* search : {&about_altitude, &anywhere}) search->look(rig);
    found.setRig(rig);
  }

  // Both pyramids need the same number.
  static int levels(const StereoRig& r) {
    return std::min(GrayPyramid::levels(r.left.width, r.left.height, kSparseLevels),
                    GrayPyramid::levels(r.right.width, r.right.height, kSparseLevels));
  }

  void ended(const char* stage) const {
    if (observer) observer(stage);
  }
  [[nodiscard]] Eigen::Vector2d viewNode(int i, int j) const {
    return {i * (rig.left.width - 1.0) / (kViewNodes - 1), j * (rig.left.height - 1.0) / (kViewNodes - 1)};
  }
  // Of corners of the left image in the right one, and back.
  struct Search {
    EpipolarSearch to_right, to_left;
    Search(const StereoRig& r, const SparseStereoConfig& c, double radius)
        : to_right(r.right, r.T_right_left, kTopPixel, radius, c.min_range, c.max_range),
          to_left(r.left, r.T_right_left.inverse(), kTopPixel, radius, c.min_range, c.max_range) {}
    void look(const StereoRig& r) {
      to_right.look(r.right, r.T_right_left);
      to_left.look(r.left, r.T_right_left.inverse());
    }
  };
  // How a pair is looked at: at a level of the pyramids, about a plane.
  struct Look {
    int level;
    SparseStereoConfig limits;
    Search& search;
    ViewPlane left_plane, right_plane;
  };
  [[nodiscard]] Look lookAt(int level, Search& search, const SeedPlane& plane) const;
  [[nodiscard]] PixelBox sharedView(const Look& look) const;
  void match(const Corner& corner, const Look& look, StereoResult& out);
  void process(const Look& look, const ImageMask* mask, int quota, StereoResult& out);

  StereoRig rig;
  SparseStereoConfig config;
  WideSearch wide;
  Search about_altitude, anywhere;
  GrayPyramid left_pyramid, right_pyramid;
  HarrisCorners harris;
  PatchTracker tracker, core;
  MatchPoints found;
  LocalMesh mesh;
  std::vector<Eigen::Vector3d> view_rays;  // of the lattice's nodes, row by row
  StereoResult result, further;            // further: of a look that may replace the result
  std::function<void(const char* stage)> observer;
};

SparseStereo::Impl::Look SparseStereo::Impl::lookAt(int level, Search& search, const SeedPlane& plane) const {
  const Eigen::Vector3d normal = rig.T_right_left.rotation() * plane.normal;
  return {level,
          limitsAt(level, config),
          search,
          {plane.normal, plane.distance},
          {normal, plane.distance + normal.dot(rig.T_right_left.translation())}};
}

// The part of the left image with seeds in the right image: a box about the visible nodes of a
// coarse lattice.
PixelBox SparseStereo::Impl::sharedView(const Look& look) const {
  const int half = config.window / 2;
  const Eigen::Vector2d spacing = viewNode(1, 1);
  PixelBox box{rig.left.width, rig.left.height, 0, 0};
  for (int j = 0; j < kViewNodes; ++j) {
    for (int i = 0; i < kViewNodes; ++i) {
      Eigen::Vector2d seen;
      const Eigen::Vector3d& ray = view_rays[static_cast<std::size_t>(j * kViewNodes + i)];
      if (!look.search.to_right.seed(ray, look.left_plane, half, seen)) continue;
      const Eigen::Vector2d low = viewNode(i, j) - spacing, high = viewNode(i, j) + spacing;
      box.x0 = std::min(box.x0, static_cast<int>(low.x()));
      box.y0 = std::min(box.y0, static_cast<int>(low.y()));
      box.x1 = std::max(box.x1, static_cast<int>(high.x()) + 1);
      box.y1 = std::max(box.y1, static_cast<int>(high.y()) + 1);
    }
  }
  return box;
}

void SparseStereo::Impl::match(const Corner& corner, const Look& look, StereoResult& out) {
  const int half = look.limits.window / 2, pixel = 1 << look.level;
  const Eigen::Vector2d left(corner.x * pixel, corner.y * pixel);
  const Eigen::Vector3d left_ray = rig.left.ray(left);
  const PatchMatch there =
      tracker.track(left_pyramid, left, right_pyramid,
                    look.search.to_right.candidates(left_ray, look.left_plane), look.level);
  if (!there.found || there.correlation < config.min_correlation ||
      !rig.right.contains(there.position, half)) {
    ++out.rejected.no_track;
    return;
  }
  const PatchMatch middle = core.polish(left_pyramid.level(look.level), left / pixel,
                                        right_pyramid.level(look.level), there.position / pixel);
  if (!middle.found || (pixel * middle.position - there.position).norm() > look.limits.max_core_distance) {
    ++out.rejected.no_track;
    return;
  }
  if (!found.showsGround(look.limits, left, there.position, out)) return;
  out.matches.push_back({left, there.position});
  MatchPoints::Rays rays;
  if (!found.nearEpipolarLine(look.limits, left, left_ray, there.position, rays, out)) return;
  const PatchMatch back =
      tracker.track(right_pyramid, there.position, left_pyramid,
                    look.search.to_left.candidates(rays.right, look.right_plane), look.level);
  if (!back.found || (back.position - left).norm() > look.limits.max_left_right_distance) {
    ++out.rejected.left_right;
    return;
  }
  found.add(look.limits, left, there.position, rays, there.covariance, out);
}

void SparseStereo::Impl::process(const Look& look, const ImageMask* mask, int quota, StereoResult& out) {
  const int pixel = 1 << look.level;
  PixelBox box = sharedView(look);
  for (int* edge : {&box.x0, &box.y0, &box.x1, &box.y1}) *edge /= pixel;
  const auto& corners = harris.find(left_pyramid.level(look.level), box, config.window / 2, quota);
  out.corners = static_cast<std::uint32_t>(corners.size());
  ended("corners");

  for (const Corner& corner : corners) match(corner, look, out);
  found.widen(out);
  ended("tracking");
  mesh.dropOutliers(config, out);
  ended("outliers");
  mesh.triangulate(config, out, mask);
  ended("triangles");
}

SparseStereo::SparseStereo(const StereoRig& rig, const SparseStereoConfig& config, const Kernels* kernels) {
  validate(rig, config);
  impl_ = std::make_unique<Impl>(rig, config, kernels != nullptr ? *kernels : fastestKernels());
}

SparseStereo::~SparseStereo() = default;

void SparseStereo::setRig(const StereoRig& rig) {
  impl_->rig = rig;
  impl_->look();
}

void SparseStereo::setStageObserver(std::function<void(const char* stage)> observer) {
  impl_->observer = std::move(observer);
}

const StereoResult& SparseStereo::process(const ImageView& left, const ImageView& right,
                                          const SeedPlane& plane, int max_features) {
  Impl& m = *impl_;
  if (!m.found.begin(left, right, plane, m.result)) return m.result;

  m.left_pyramid.build(left);
  m.right_pyramid.build(right);
  m.ended("pyramids");

  const int quota = max_features > 0 ? std::min(max_features, m.config.max_features) : m.config.max_features;
  m.process(m.lookAt(0, m.about_altitude, plane), left.mask, quota, m.result);
  const auto fewer = [&](double share) {
    return static_cast<double>(m.result.points.size()) < share * quota;
  };
  const auto lookAgain = [&](const Impl::Look& look, int corners) {
    (void)m.found.begin(left, right, plane, m.further);
    m.process(look, left.mask, corners, m.further);
    if (m.further.points.size() > m.result.points.size()) std::swap(m.result, m.further);
  };
  const int more = m.config.look_again ? mostFeatures(m.config) : quota;
  if (more > quota && !fewer(kFewPoints) && fewer(kEnoughPoints))
    lookAgain(m.lookAt(0, m.about_altitude, plane), more);
  for (int level = 1; fewer(kFewPoints) && level < m.left_pyramid.levels(); ++level)
    lookAgain(m.lookAt(level, m.anywhere, m.wide.plane), more);
  return m.result;
}

void visitSparseStereo(KeyVisitor& keys, SparseStereoConfig& c) {
  keys.integer("max_features", c.max_features, "corners", 20, 5000, "wanted in an image");
  keys.integer("window_px", c.window, "px", PatchTracker::kMinWindow, PatchTracker::kMaxWindow,
               "edge of the matching window, odd");
  keys.require(c.window % 2 == 1, "window_px", "must be odd");
  keys.number("max_epipolar_px", c.max_epipolar_distance, "px", 0.1, 10,
              "further off the epipolar line a match is dropped");
  keys.number("max_left_right_px", c.max_left_right_distance, "px", 0.05, 10, "left-right check");
  keys.number("max_core_px", c.max_core_distance, "px", 0.05, 10,
              "between the whole window's match and its middle's");
  keys.number("min_correlation", c.min_correlation, "", 0, 0.99, "of the two windows, zero-mean normalised");
  keys.number("sigma_scale", c.sigma_scale, "", 0.1, 10, "of all standard deviations; 1 is calibrated");
  keys.number("search_radius_px", c.search_radius, "px", 1, 256,
              "reach of the search along the epipolar line about the seed");
  keys.number("min_range_m", c.min_range, "m", 0.05, 50, "least accepted depth");
  keys.number("max_range_m", c.max_range, "m", 0.1, 100, "largest accepted depth");
  keys.require(c.max_range > c.min_range, "max_range_m", "must be greater than min_range_m");
  keys.number("max_edge_m", c.max_edge, "m", 0.01, 10, "longest triangle edge");
  keys.integer("min_patch_points", c.min_patch_points, "points", 1, 1000,
               "smaller groups that nothing joins to the rest are dropped");
  keys.number("max_fish_length_m", c.max_fish_length, "m", 0, 10,
              "longest thing in mid-water that is dropped as a fish; 0: none");
}

void toMesh(const StereoResult& result, const ImageView& left_rgb, Mesh& mesh) {
  const bool coloured = !left_rgb.empty() && left_rgb.bits == 8 && left_rgb.format != PixelFormat::kBayerRggb;
  const int step = coloured ? colourStep(left_rgb, result.points.size()) : 1;
  mesh.vertices.clear();
  mesh.colours.clear();
  mesh.texture_coordinates.clear();
  mesh.sigma.clear();
  for (const StereoPoint& p : result.points) {
    mesh.vertices.push_back(p.point);
    mesh.sigma.push_back(p.sigma_z);
    if (coloured) mesh.colours.push_back(colourAbout(left_rgb, p.left, step));
  }
  mesh.triangles.assign(result.triangles.begin(), result.triangles.end());
  computeNormals(mesh);
}

Mesh toMesh(const StereoResult& result, const ImageView& left_rgb) {
  Mesh mesh;
  toMesh(result, left_rgb, mesh);
  return mesh;
}

}  // namespace fathom::stereo
