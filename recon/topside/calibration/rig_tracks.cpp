#include "recon/topside/calibration/rig_tracks.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <opencv2/features2d.hpp>
#include <utility>

#include "realtime/base/numbers/union_find.hpp"
#include "realtime/base/progress.hpp"
#include "recon/import/images/loose_pair.hpp"

namespace fathom::topside {
namespace {

constexpr int kFeatures = 4000;      // of an image
constexpr double kContrast = 0.004;  // of SIFT: mud has little
constexpr double kShift = -0.25;     // of what OpenCV 4.6 finds, off the true place [px]
constexpr float kRatio = 0.8F;       // to the second best
constexpr std::size_t kAhead = 3;    // pairs

struct Image {
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
};

Image describe(const std::filesystem::path& path, const std::string& format, const Camera& size) {
  const LooseImage read = readLooseImage(path, samplesNamed(format), size);
  const cv::Mat mono(read.height, read.width, CV_8UC1, const_cast<std::uint8_t*>(read.mono.data()));
  Image out;
  cv::SIFT::create(kFeatures, 3, kContrast)
      ->detectAndCompute(mono, cv::noArray(), out.points, out.descriptors);
  return out;
}

// Indices into both.
using Matches = std::vector<std::pair<int, int>>;

using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Map<const Rows> rowsOf(const cv::Mat& descriptors) {
  return {descriptors.ptr<float>(), descriptors.rows, descriptors.cols};
}

Matches matched(const Image& a, const Image& b) {
  Matches out;
  if (a.points.size() < 2 || b.points.size() < 2) return out;
  const auto of_a = rowsOf(a.descriptors), of_b = rowsOf(b.descriptors);
  const Eigen::VectorXf squares_a = of_a.rowwise().squaredNorm(), squares_b = of_b.rowwise().squaredNorm();
  struct Nearest {
    float distance2 = std::numeric_limits<float>::max();
    int other = -1;
  };
  std::vector<Nearest> forth(a.points.size()), second(a.points.size()), back(b.points.size());
  constexpr int kBlock = 256;  // rows at a time
  Rows products;
  for (int first = 0; first < of_a.rows(); first += kBlock) {
    const int count = std::min(kBlock, static_cast<int>(of_a.rows()) - first);
    products.noalias() = of_a.middleRows(first, count) * of_b.transpose();
    for (int i = 0; i < count; ++i) {
      const auto row = static_cast<std::size_t>(first + i);
      for (int j = 0; j < of_b.rows(); ++j) {
        const float d = squares_a(first + i) + squares_b(j) - 2 * products(i, j);
        Nearest& from_b = back[static_cast<std::size_t>(j)];
        if (d < from_b.distance2) from_b = {d, first + i};
        if (d < forth[row].distance2) {
          second[row] = forth[row];
          forth[row] = {d, j};
        } else if (d < second[row].distance2) {
          second[row] = {d, j};
        }
      }
    }
  }
  for (std::size_t i = 0; i < forth.size(); ++i)
    if (forth[i].distance2 < kRatio * kRatio * second[i].distance2 &&
        back[static_cast<std::size_t>(forth[i].other)].other == static_cast<int>(i))
      out.emplace_back(static_cast<int>(i), forth[i].other);
  return out;
}

calibration::ImageSize sizeOf(const std::filesystem::path& path, const std::string& format) {
  const io::ImageFile file = readSamples(path, samplesNamed(format));
  return {file.view.width, file.view.height};
}

Camera ofSize(const calibration::ImageSize& size) {
  Camera out;
  out.width = size.width, out.height = size.height;
  return out;
}

// Both images of every pair, left before right.
std::vector<Image> describeAll(const BoardImageOptions& options, const std::vector<StereoFilePair>& pairs,
                               const Camera& left, const Camera& right) {
  std::vector<Image> images(2 * pairs.size());
  rt::StageProgress progress("features", images.size());
  oneapi::tbb::parallel_for(std::size_t{0}, images.size(), [&](std::size_t k) {
    const StereoFilePair& pair = pairs[k / 2];
    images[k] = k % 2 == 0 ? describe(pair.left, options.left_format, left)
                           : describe(pair.right, options.right_format, right);
    progress.step();
  });
  return images;
}

// Pairs of images that are matched.
std::vector<std::pair<std::size_t, std::size_t>> neighbours(std::size_t pairs) {
  std::vector<std::pair<std::size_t, std::size_t>> out;
  for (std::size_t k = 0; k < pairs; ++k) {
    out.emplace_back(2 * k, 2 * k + 1);
    for (std::size_t next = k + 1; next <= std::min(k + kAhead, pairs - 1); ++next)
      for (const std::size_t side : {0U, 1U}) out.emplace_back(2 * k + side, 2 * next + side);
  }
  return out;
}

}  // namespace

calibration::RigTracks findTracks(const BoardImageOptions& options, std::size_t most) {
  std::vector<StereoFilePair> pairs = findStereoFiles(options).pairs;
  if (pairs.size() > most) {
    const auto first = pairs.begin() + static_cast<std::ptrdiff_t>((pairs.size() - most) / 2);
    pairs = std::vector(first, first + static_cast<std::ptrdiff_t>(most));
  }
  calibration::RigTracks out;
  out.left = sizeOf(pairs[0].left, options.left_format);
  out.right = sizeOf(pairs[0].right, options.right_format);
  for (const StereoFilePair& pair : pairs) out.names.push_back(pair.left.filename().string());
  const std::vector<Image> images = describeAll(options, pairs, ofSize(out.left), ofSize(out.right));

  const auto wanted = neighbours(pairs.size());
  std::vector<Matches> matches(wanted.size());
  {
    rt::StageProgress progress("matches", wanted.size());
    oneapi::tbb::parallel_for(std::size_t{0}, wanted.size(), [&](std::size_t k) {
      matches[k] = matched(images[wanted[k].first], images[wanted[k].second]);
      progress.step();
    });
  }
  // What matches join is one place; two sightings in one image say that a match is wrong.
  std::vector<std::size_t> first(images.size() + 1, 0);
  for (std::size_t i = 0; i < images.size(); ++i) first[i + 1] = first[i] + images[i].points.size();
  UnionFind places(first.back());
  for (std::size_t k = 0; k < wanted.size(); ++k)
    for (const auto& [a, b] : matches[k])
      places.join(static_cast<std::uint32_t>(first[wanted[k].first]) + static_cast<std::uint32_t>(a),
                  static_cast<std::uint32_t>(first[wanted[k].second]) + static_cast<std::uint32_t>(b));
  std::vector<calibration::RigTrack> tracks(first.back());
  std::vector<bool> wrong(first.back(), false);
  for (std::size_t i = 0; i < images.size(); ++i)
    for (std::size_t k = 0; k < images[i].points.size(); ++k) {
      const std::size_t place = places.root(static_cast<std::uint32_t>(first[i] + k));
      auto& sightings = tracks[place].sightings;
      const auto pair = static_cast<std::uint32_t>(i / 2);
      const bool right = i % 2 == 1;
      wrong[place] = wrong[place] ||
                     (!sightings.empty() && sightings.back().pair == pair && sightings.back().right == right);
      const cv::Point2f& at = images[i].points[k].pt;
      sightings.push_back({pair, right, Eigen::Vector2d(at.x + kShift, at.y + kShift)});
    }
  for (std::size_t k = 0; k < tracks.size(); ++k)
    if (!wrong[k] && tracks[k].sightings.size() > 1) out.tracks.push_back(std::move(tracks[k]));
  return out;
}

}  // namespace fathom::topside
