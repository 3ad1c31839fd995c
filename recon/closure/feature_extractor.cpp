#include "recon/closure/feature_extractor.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>

#include "recon/closure/feature_slot.hpp"
#include "recon/geometry/image_mask.hpp"

namespace fathom::closure {
namespace {

constexpr int kCellsAcross = 8, kCellsDown = 6;  // each gets its share of the features first
constexpr float kOrbScale = 1.2F;                // from one image size of ORB to the next
constexpr double kSurplus = 1.5;  // features detected for one kept: not all are found in stereo

void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(std::string("closure features: ") + what);
}

bool isWindow(int edge) {
  return edge >= 5 && edge <= 31 && edge % 2 == 1;
}

void validate(const StereoRig& rig, const FeatureConfig& c) {
  for (const Camera* camera : {&rig.left, &rig.right}) {
    require(camera->width >= 1 && camera->height >= 1, "the rig has no image size");
    require(camera->fx > 0 && camera->fy > 0, "the rig has no focal length");
  }
  require(rig.baseline() > 0, "the rig has no baseline");
  require(descriptorBytes(c.kind) > 0, "unknown descriptor");
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

// Thresholds are low, so that poor images give features too; thinning keeps the strongest.
cv::Ptr<cv::Feature2D> detectorOf(DescriptorKind kind, int wanted) {
  constexpr double kSiftContrast = 0.02;  // of values 0 to 1
  constexpr float kAkazeThreshold = 3e-4F;
  constexpr int kBriskThreshold = 20, kFastThreshold = 7;  // [grey levels]
  switch (kind) {
    case DescriptorKind::kOrb:
      return cv::ORB::create(3 * wanted, kOrbScale, 8, 31, 0, 2, cv::ORB::HARRIS_SCORE, 31, kFastThreshold);
    case DescriptorKind::kAkaze:
      return cv::AKAZE::create(cv::AKAZE::DESCRIPTOR_MLDB, 0, 3, kAkazeThreshold);
    case DescriptorKind::kBrisk:
      return cv::BRISK::create(kBriskThreshold);
    case DescriptorKind::kRootSift:
      break;
  }
  return cv::SIFT::create(0, 3, kSiftContrast);
}

// Where a key point truly lies, the centre of the top left pixel being (0, 0). OpenCV 4.6 shifts two kinds by
// leaving the half pixels out when it goes from one image size to another: SIFT from the image of twice the
// size in which it begins (corrected there in 4.8, "precise upscale"), ORB from each smaller image.
Eigen::Vector2d placeOf(const cv::KeyPoint& p, DescriptorKind kind) {
  constexpr double kSiftShift = 0.25;  // [px]
  double shift = 0;
  if (kind == DescriptorKind::kRootSift) shift = -kSiftShift;
  if (kind == DescriptorKind::kOrb) shift = 0.5 * (std::pow(static_cast<double>(kOrbScale), p.octave) - 1);
  return {static_cast<double>(p.pt.x) + shift, static_cast<double>(p.pt.y) + shift};
}

// The strongest, an equal share of every cell of the image first. Keeps the order by strength, ties by place.
void thin(std::vector<cv::KeyPoint>& points, const cv::Size& size, std::size_t wanted) {
  const auto key = [](const cv::KeyPoint& p) {
    return std::make_tuple(-p.response, p.pt.y, p.pt.x, p.size, p.angle);
  };
  std::sort(points.begin(), points.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
  if (points.size() <= wanted) return;
  const std::size_t share = wanted / (kCellsAcross * kCellsDown);
  std::array<std::size_t, kCellsAcross * kCellsDown> taken{};
  std::vector<cv::KeyPoint> kept, rest;
  for (const cv::KeyPoint& p : points) {
    const int i = std::clamp(static_cast<int>(p.pt.x) * kCellsAcross / size.width, 0, kCellsAcross - 1);
    const int j = std::clamp(static_cast<int>(p.pt.y) * kCellsDown / size.height, 0, kCellsDown - 1);
    std::size_t& count = taken[static_cast<std::size_t>(j * kCellsAcross + i)];
    (count++ < share ? kept : rest).push_back(p);
  }
  kept.insert(kept.end(), rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(wanted - kept.size()));
  points = std::move(kept);
}

// Square roots of the histogram divided by its sum, in steps of 1/512: a whole descriptor has the norm 512.
void rootSift(const float* histogram, std::uint8_t* out) {
  constexpr double kNorm = 512, kTop = 255;
  double sum = 0;
  for (int k = 0; k < 128; ++k) sum += static_cast<double>(histogram[k]);
  for (int k = 0; k < 128; ++k) {
    const double root = sum > 0 ? kNorm * std::sqrt(static_cast<double>(histogram[k]) / sum) : 0.0;
    out[k] = static_cast<std::uint8_t>(std::lround(std::min(root, kTop)));
  }
}

// A camera in the same place that looks at the seafloor at right angles: its image is the seafloor's own, to
// scale, whatever the true one's slant. It has the small image's resolution of the ground where that is in
// the middle of the image.
class FromAbove {
 public:
  FromAbove(const Camera& camera, int shrink, const Eigen::Vector3d& ground)
      : camera_(camera),
        shrink_(shrink),
        turn_(Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), ground)),
        focal_(camera.fx / shrink * ground.z()) {
    // What the image's border shows, but for what it sees nearly edge-on.
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

  // Outside of the image that the camera took: -1.
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

// Cosine of the principal ray from the seafloor's normal: below the first, features are sought from above;
// below the second a camera looks along the seafloor rather than at it.
constexpr double kSlant = 0.91, kGrazing = 0.26;

}  // namespace

struct FeatureExtractor::Impl {
  Impl(const StereoRig& r, const FeatureConfig& c)
      : rig(r), config(c), matcher(r, c.stereo), detector(detectorOf(c.kind, c.max_features)) {
    while (rig.left.width / shrink > config.max_width) shrink *= 2;
    result.kind = c.kind;
  }
  void ended(const char* stage) const {
    if (observer) observer(stage);
  }
  // Of the left image, for a place where features were sought.
  [[nodiscard]] Eigen::Vector2d pixelOf(const Eigen::Vector2d& place) const {
    const Eigen::Vector2d half(0.5, 0.5);  // centres: x + 1/2 of the small image is shrink (x + 1/2)
    return from_above ? from_above->pixelOf(place) : Eigen::Vector2d(shrink * (place + half) - half);
  }

  StereoRig rig;
  FeatureConfig config;
  StereoMatcher matcher;
  cv::Ptr<cv::Feature2D> detector;
  int shrink = 1;
  std::vector<cv::KeyPoint> points, seen;  // found by the detector; and found in the right image too
  std::vector<Feature> places;             // of `seen`
  std::optional<FromAbove> from_above;
  cv::Mat small, above, descriptors;
  FrameFeatures result;
  std::function<void(const char* stage)> observer;
};

FeatureExtractor::FeatureExtractor(const StereoRig& rig, const FeatureConfig& config) {
  validate(rig, config);
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

const FrameFeatures& FeatureExtractor::process(const ImageView& left, const ImageView& right,
                                               const DepthRange& depths, const Eigen::Vector3d& ground) {
  Impl& m = *impl_;
  m.result.features.clear();
  m.result.descriptors.clear();
  const DepthRange range{std::max(depths.nearest, m.config.depths.nearest),
                         std::min(depths.farthest, m.config.depths.farthest)};
  if (!fits(left, m.rig.left) || !fits(right, m.rig.right) || !(range.nearest < range.farthest))
    return m.result;

  const cv::Mat whole(left.height, left.width, CV_8UC1, const_cast<void*>(left.data), left.stride);
  if (m.shrink == 1)
    m.small = whole;
  else
    cv::resize(whole, m.small, {left.width / m.shrink, left.height / m.shrink}, 0, 0, cv::INTER_AREA);
  m.from_above.reset();
  if (ground.z() < kSlant && ground.z() > kGrazing) {
    m.from_above.emplace(m.rig.left, m.shrink, ground);
    m.from_above->draw(m.small, m.above);
  }
  const cv::Mat& seen_so = m.from_above ? m.above : m.small;
  const auto wanted = static_cast<std::size_t>(m.config.max_features);
  m.detector->detect(seen_so, m.points);
  if (left.mask != nullptr)
    std::erase_if(m.points, [&](const cv::KeyPoint& p) {
      const double radius = 0.5 * m.shrink * static_cast<double>(p.size);
      return left.mask->hides(m.pixelOf(placeOf(p, m.config.kind)), radius);
    });
  thin(m.points, seen_so.size(), static_cast<std::size_t>(kSurplus * m.config.max_features));
  m.ended("detect");

  // Only what both cameras see is worth describing.
  m.seen.clear();
  m.places.clear();
  for (const cv::KeyPoint& p : m.points) {
    if (m.seen.size() == wanted) break;
    const Eigen::Vector2d pixel = m.pixelOf(placeOf(p, m.config.kind));
    StereoMatch found;
    if (!m.matcher.match(left, right, pixel, range, found)) continue;
    if (right.mask != nullptr && right.mask->hides(found.right, m.config.stereo.refine_window / 2)) continue;
    const double size = static_cast<double>(p.size);
    const double sigma = m.shrink * (m.config.place_sigma + m.config.place_sigma_per_size * size);
    const Eigen::Matrix3f c = m.matcher.pointCovariance(pixel, found, sigma).cast<float>();
    if (!(c.determinant() > 0)) continue;
    m.places.push_back({pixel.cast<float>(),
                        found.right.cast<float>(),
                        found.point.cast<float>(),
                        {c(0, 0), c(0, 1), c(0, 2), c(1, 1), c(1, 2), c(2, 2)},
                        static_cast<float>(m.shrink * size)});
    m.seen.push_back(p);
    if (m.config.kind != DescriptorKind::kAkaze) m.seen.back().class_id = static_cast<int>(m.seen.size()) - 1;
  }
  m.ended("stereo");

  if (!m.seen.empty()) m.detector->compute(seen_so, m.seen, m.descriptors);
  const std::size_t bytes = descriptorBytes(m.config.kind);
  for (std::size_t i = 0; i < m.seen.size(); ++i) {
    // Kinds that drop points near the border or change their order keep the number; AKAZE, which keeps the
    // level in it, does neither.
    const std::size_t place =
        m.config.kind == DescriptorKind::kAkaze ? i : static_cast<std::size_t>(m.seen[i].class_id);
    m.result.features.push_back(m.places[place]);
    m.result.descriptors.resize(m.result.size() * bytes);
    std::uint8_t* out = m.result.descriptors.data() + i * bytes;
    if (m.config.kind == DescriptorKind::kRootSift)
      rootSift(m.descriptors.ptr<float>(static_cast<int>(i)), out);
    else
      std::copy_n(m.descriptors.ptr(static_cast<int>(i)), bytes, out);
  }
  m.ended("describe");
  return m.result;
}

}  // namespace fathom::closure
