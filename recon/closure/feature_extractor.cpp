#include "recon/closure/feature_extractor.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>

#include "recon/closure/scale_space.hpp"

namespace fathom::closure {
namespace {

constexpr float kOrbScale = 1.2F;  // from one image size of ORB to the next
constexpr double kSurplus = 1.5;   // features detected for each one kept: not all are found in stereo

bool isWindow(int edge) {
  return edge >= 5 && edge <= 31 && edge % 2 == 1;
}

void validateFeatures(const StereoRig& rig, const FeatureConfig& c) {
  const auto require = [](bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(std::string("closure features: ") + what);
  };
  for (const Camera* camera : {&rig.left, &rig.right}) {
    require(camera->width >= 1 && camera->height >= 1, "the rig has no image size");
    require(camera->fx > 0 && camera->fy > 0, "the rig has no focal length");
  }
  require(rig.baseline() > 0, "the rig has no baseline");
  require(c.max_features >= 1 && c.max_features <= static_cast<int>(kMaxSlotFeatures),
          "max_features must be 1 to 65535");
  require(c.max_width >= 64, "max_width must be at least 64 px");
  require(c.place_sigma > 0 && c.place_sigma_per_size >= 0, "place_sigma must be positive");
  require(c.depths.nearest > 0 && c.depths.farthest > c.depths.nearest,
          "depths must be 0 < nearest < farthest");
  require(isWindow(c.stereo.search_window) && isWindow(c.stereo.refine_window),
          "windows must be odd, 5 to 31 px");
  require(c.stereo.min_correlation > 0 && c.stereo.min_correlation < 1, "min_correlation must be 0 to 1");
}

bool fits(const ImageView& image, const Camera& camera) {
  return !image.empty() && image.format == PixelFormat::kMono && image.bits == 8 &&
         image.width == camera.width && image.height == camera.height &&
         image.stride >= static_cast<std::size_t>(image.width);
}

Eigen::Vector2d placeOf(const KeyPoint& p) {
  return Eigen::Vector2f(p.x, p.y).cast<double>();
}

// Of points by strength the strongest, an equal share of every cell of the image first.
void thin(std::vector<KeyPoint>& points, const cv::Size& size, std::size_t wanted) {
  if (points.size() <= wanted) return;
  const std::size_t share = wanted / (kCellsAcross * kCellsDown);
  std::array<std::size_t, kCellsAcross * kCellsDown> taken{};
  std::vector<KeyPoint> kept, rest;
  for (const KeyPoint& p : points) {
    const int i = std::clamp(static_cast<int>(p.x) * kCellsAcross / size.width, 0, kCellsAcross - 1);
    const int j = std::clamp(static_cast<int>(p.y) * kCellsDown / size.height, 0, kCellsDown - 1);
    std::size_t& count = taken[static_cast<std::size_t>(j * kCellsAcross + i)];
    (count++ < share ? kept : rest).push_back(p);
  }
  kept.insert(kept.end(), rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(wanted - kept.size()));
  points = std::move(kept);
}

// Square roots of the histogram divided by its sum, in steps of 1/512: a whole descriptor has the norm 512.
void rootSift(std::span<const float, ScaleSpace::kDescriptor> histogram, std::uint8_t* out) {
  constexpr double kNorm = 512, kTop = 255;
  double sum = 0;
  for (const float v : histogram) sum += static_cast<double>(v);
  for (const float v : histogram) {
    const double root = sum > 0 ? kNorm * std::sqrt(static_cast<double>(v) / sum) : 0.0;
    *out++ = static_cast<std::uint8_t>(std::lround(std::min(root, kTop)));
  }
}

// False, and nothing is added, where the point has no positive definite covariance in single precision.
bool addFeature(const StereoMatcher& matcher, const Eigen::Vector2d& left, const StereoMatch& match,
                double place_sigma, float size, std::vector<Feature>& features) {
  const Eigen::Matrix3f c = matcher.pointCovariance(left, match, place_sigma).cast<float>();
  if (!(c.determinant() > 0)) return false;
  features.push_back(
      {left.cast<float>(), match.right.cast<float>(), match.point.cast<float>(), upperTriangle(c), size});
  return true;
}

// False when the rays do not meet within the limits.
bool triangulateGiven(const StereoFeature& f, const StereoRig& rig, const GivenFeatureLimits& limits,
                      StereoMatch& match) {
  match.right = f.right.cast<double>();
  const double sigma = static_cast<double>(f.match_sigma);
  match.covariance = sigma * sigma * Eigen::Matrix2d::Identity();
  double gap = 0;
  if (!triangulatePixels(rig, f.left.cast<double>(), match.right, match.point, gap)) return false;
  const double z = match.point.z();
  return z >= limits.depths.nearest && z <= limits.depths.farthest &&
         gap * rig.left.fx / z <= limits.max_epipolar_distance;
}

// The view of a virtual camera at the same place that looks at the seafloor at right angles: the seafloor to
// scale, whatever the true camera's slant. It has the small image's ground resolution at the middle of that.
class FromAbove {
 public:
  FromAbove(const Camera& camera, int shrink, const Eigen::Vector3d& ground)
      : camera_(camera),
        shrink_(shrink),
        turn_(Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), ground)),
        focal_(camera.fx / shrink * ground.z()) {
    // The bounds of the image's border on the ground, limited where it is nearly edge-on.
    constexpr int kSteps = 16;
    Eigen::Vector2d low = Eigen::Vector2d::Constant(INFINITY), high = -low;
    for (int i = 0; i <= kSteps; ++i)
      for (const auto& [x, y] : {std::pair(i, 0), {i, kSteps}, {0, i}, {kSteps, i}}) {
        const Eigen::Vector2d pixel(x * (camera.width - 1.0) / kSteps, y * (camera.height - 1.0) / kSteps);
        const Eigen::Vector3d ray = turn_.conjugate() * camera.ray(pixel).normalized();
        const Eigen::Vector2d at = ray.head<2>() / std::max(ray.z(), kEdgeOn);
        low = low.cwiseMin(at);
        high = high.cwiseMax(at);
      }
    low_ = low;
    size_ = {std::max(1, static_cast<int>(focal_ * (high - low).x())),
             std::max(1, static_cast<int>(focal_ * (high - low).y()))};
  }

  // In the camera's image; (-1, -1) outside.
  [[nodiscard]] Eigen::Vector2d pixelOf(const Eigen::Vector2d& place) const {
    Eigen::Vector3d ray;
    ray << low_ + place / focal_, 1;
    ray = turn_ * ray;
    return ray.z() > kEdgeOn ? camera_.project(ray) : Eigen::Vector2d(Eigen::Vector2d::Constant(-1));
  }
  void draw(const cv::Mat& small, cv::Mat& out) const {
    cv::Mat_<cv::Point2f> from(size_);
    for (int y = 0; y < size_.height; ++y)
      for (int x = 0; x < size_.width; ++x) {
        const Eigen::Vector2d pixel = (pixelOf({x, y}).array() + 0.5) / shrink_ - 0.5;
        from(y, x) = {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
      }
    cv::remap(small, out, from, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  }

 private:
  static constexpr double kEdgeOn = 0.2;  // of a ray, along the normal or the principal axis [1]

  const Camera& camera_;
  int shrink_;
  Eigen::Quaterniond turn_;
  double focal_;         // [px]
  Eigen::Vector2d low_;  // tangents of the first pixel
  cv::Size size_;
};

// Cosine of the angle from the seafloor's normal to the principal ray: below kSlant the image is rectified to
// a view from above; below kGrazing the camera looks along the seafloor, and it is not.
constexpr double kSlant = 0.91, kGrazing = 0.26;

}  // namespace

struct FeatureExtractor::Impl {
  Impl(const StereoRig& r, const FeatureConfig& c) : rig(r), config(c), matcher(r, c.stereo) {
    while (rig.left.width / shrink > config.max_width) shrink *= 2;
  }
  void ended(const char* stage) const {
    if (observer) observer(stage);
  }
  // Fills `result`.
  void find(const ImageView& left, const ImageView& right, const DepthRange& range,
            const Eigen::Vector3d& ground);
  // Without much of its noise; what stands out of its surroundings raised, where that is little.
  ImageView smoothed(const ImageView& image, cv::Mat& out);
  // Pixel of the left image for a place in the image of the detector.
  [[nodiscard]] Eigen::Vector2d pixelOf(const Eigen::Vector2d& place) const {
    const Eigen::Vector2d half(0.5, 0.5);  // centres: x + 1/2 of the small image is shrink (x + 1/2)
    return from_above ? from_above->pixelOf(place) : Eigen::Vector2d(shrink * (place + half) - half);
  }

  StereoRig rig;
  FeatureConfig config;
  StereoMatcher matcher;
  // The threshold is low, so that poor images give features too; thinning keeps the strongest.
  static constexpr double kContrast = 0.02;
  ScaleSpace scale_space{kContrast};
  int shrink = 1;
  std::vector<KeyPoint> points, matched;  // found by the detector; found in the right image too
  std::optional<FromAbove> from_above;
  cv::Mat small, above, around, smooth_left, smooth_right;
  FrameFeatures result, sharp;  // sharp: of images as they came, where these gave few
  std::function<void(const char* stage)> observer;
};

FeatureExtractor::FeatureExtractor(const StereoRig& rig, const FeatureConfig& config) {
  validateFeatures(rig, config);
  impl_ = std::make_unique<Impl>(rig, config);
}

FeatureExtractor::~FeatureExtractor() = default;

void FeatureExtractor::setRig(const StereoRig& rig) {
  impl_->rig = rig;
  impl_->matcher = StereoMatcher(rig, impl_->config.stereo);
}

void FeatureExtractor::setStageObserver(std::function<void(const char* stage)> observer) {
  impl_->observer = std::move(observer);
}

const FrameFeatures& FeatureExtractor::process(const ImageView& left, const ImageView& right) {
  return process(left, right, impl_->config.depths);
}

ImageView FeatureExtractor::Impl::smoothed(const ImageView& image, cv::Mat& out) {
  constexpr double kSigma = 1;                              // [px]
  constexpr int kNear = 20, kFar = 40;                      // [px of the halved image]
  constexpr double kMiddle = 128, kEnough = 12, kMost = 8;  // mean, mean deviation, gain
  const cv::Mat whole(image.height, image.width, CV_8UC1, const_cast<void*>(image.data), image.stride);
  cv::GaussianBlur(whole, out, {}, kSigma);
  cv::blur(whole, around, {shrink * kNear + 1, shrink * kNear + 1});
  const double deviation = cv::norm(out, around, cv::NORM_L1) / static_cast<double>(whole.total());
  const double gain = std::clamp(kEnough / std::max(deviation, 1e-3), 1.0, kMost);
  cv::blur(whole, around, {shrink * kFar + 1, shrink * kFar + 1});
  cv::addWeighted(out, gain, around, -gain, kMiddle, out);
  ImageView view = image;
  view.data = out.data, view.stride = out.step;
  return view;
}

void FeatureExtractor::Impl::find(const ImageView& left, const ImageView& right, const DepthRange& range,
                                  const Eigen::Vector3d& ground) {
  result.clear();
  const cv::Mat whole(left.height, left.width, CV_8UC1, const_cast<void*>(left.data), left.stride);
  if (shrink == 1)
    small = whole;
  else
    cv::resize(whole, small, {left.width / shrink, left.height / shrink}, 0, 0, cv::INTER_AREA);
  from_above.reset();
  if (ground.z() < kSlant && ground.z() > kGrazing) {
    from_above.emplace(rig.left, shrink, ground);
    from_above->draw(small, above);
  }
  const cv::Mat& view = from_above ? above : small;
  const auto wanted = static_cast<std::size_t>(config.max_features);
  points = scale_space.detect({view.data, view.cols, view.rows, view.step});
  if (left.mask != nullptr)
    std::erase_if(points, [&](const KeyPoint& p) {
      const double radius = 0.5 * shrink * static_cast<double>(p.size);
      return left.mask->hides(pixelOf(placeOf(p)), radius);
    });
  thin(points, view.size(), static_cast<std::size_t>(kSurplus * config.max_features));
  ended("detect");

  // Features seen by both cameras alone are described.
  matched.clear();
  const int reach = config.stereo.refine_window / 2;
  for (const KeyPoint& p : points) {
    if (matched.size() == wanted) break;
    const Eigen::Vector2d pixel = pixelOf(placeOf(p));
    StereoMatch found;
    if (!matcher.match(left, right, pixel, range, found)) continue;
    if (right.mask != nullptr && right.mask->hides(found.right, reach)) continue;
    const double size = static_cast<double>(p.size);
    const double sigma = shrink * (config.place_sigma + config.place_sigma_per_size * size);
    if (!addFeature(matcher, pixel, found, sigma, static_cast<float>(shrink * size), result.features))
      continue;
    matched.push_back(p);
  }
  ended("stereo");

  result.descriptors.resize(matched.size() * kDescriptorBytes);
  std::array<float, ScaleSpace::kDescriptor> histogram{};
  for (std::size_t i = 0; i < matched.size(); ++i) {
    scale_space.describe(matched[i], histogram);
    rootSift(histogram, result.descriptors.data() + i * kDescriptorBytes);
  }
  ended("describe");
}

const FrameFeatures& FeatureExtractor::process(const ImageView& left, const ImageView& right,
                                               const DepthRange& depths, const Eigen::Vector3d& ground) {
  Impl& m = *impl_;
  m.result.clear();
  const DepthRange range{std::max(depths.nearest, m.config.depths.nearest),
                         std::min(depths.farthest, m.config.depths.farthest)};
  if (!fits(left, m.rig.left) || !fits(right, m.rig.right) || !(range.nearest < range.farthest))
    return m.result;

  m.find(left, right, range, ground);
  // In dim or murky water noise covers the texture of every pixel, but not that of several together; and the
  // contrast that a picture was given may be that of shades and of marine snow.
  constexpr std::size_t kFew = 70;
  if (m.result.size() < std::min(kFew, static_cast<std::size_t>(m.config.max_features) / 2)) {
    std::swap(m.result, m.sharp);
    m.find(m.smoothed(left, m.smooth_left), m.smoothed(right, m.smooth_right), range, ground);
    if (m.sharp.size() > m.result.size()) std::swap(m.result, m.sharp);
  }
  return m.result;
}

FrameFeatures featuresFrom(const StereoFeatureFrame& frame, const StereoRig& rig,
                           const GivenFeatureLimits& limits) {
  FrameFeatures features;
  featuresFrom(frame, rig, limits, features);
  return features;
}

void featuresFrom(const StereoFeatureFrame& frame, const StereoRig& rig, const GivenFeatureLimits& limits,
                  FrameFeatures& features) {
  features.clear();
  if (frame.width != rig.left.width || frame.height != rig.left.height) return;
  const StereoMatcher matcher(rig, {});
  for (const StereoFeature& f : frame.features) {
    if (static_cast<int>(features.size()) >= limits.max_features) break;
    StereoMatch match;
    if (!triangulateGiven(f, rig, limits, match)) continue;
    if (!addFeature(matcher, f.left.cast<double>(), match, static_cast<double>(f.place_sigma), f.size,
                    features.features))
      continue;
    features.descriptors.insert(features.descriptors.end(), f.descriptor.begin(), f.descriptor.end());
  }
}

}  // namespace fathom::closure
