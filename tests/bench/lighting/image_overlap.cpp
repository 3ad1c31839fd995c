#include "tests/bench/lighting/image_overlap.hpp"

#include <algorithm>
#include <cstdio>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "realtime/kernel/input_error.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/reports.hpp"

namespace fathom::bench {
namespace {

std::vector<cv::Mat> readImages(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.is_regular_file()) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<cv::Mat> images;
  for (const auto& file : files) {
    cv::Mat image = cv::imread(file.string(), cv::IMREAD_COLOR);
    if (image.empty()) continue;
    if (!images.empty() && image.size() != images.front().size())
      throw InputError(file, "", "is of another size than the images before it");
    cv::cvtColor(image, image, cv::COLOR_BGR2RGB);
    images.push_back(image);
  }
  if (images.size() < 2) throw InputError(folder, "", "holds fewer than two images");
  return images;
}

ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, image.step, PixelFormat::kRgb, 8};
}

struct SamePlace {
  cv::Point2f a, b;  // [px]
};

// Places that both show, by features that one homography explains up to relief; none where too few do.
std::vector<SamePlace> samePlaces(const cv::Mat& a, const cv::Mat& b) {
  const auto sift = cv::SIFT::create(8000);
  std::vector<cv::KeyPoint> in_a, in_b;
  cv::Mat words_a, words_b;
  sift->detectAndCompute(a, {}, in_a, words_a);
  sift->detectAndCompute(b, {}, in_b, words_b);
  if (words_a.rows < 2 || words_b.rows < 2) return {};
  std::vector<std::vector<cv::DMatch>> found;
  cv::BFMatcher().knnMatch(words_a, words_b, found, 2);
  std::vector<cv::Point2f> from, to;
  constexpr float kClearer = 0.75F;  // than the second best (Lowe 2004)
  for (const auto& two : found)
    if (two.size() == 2 && two[0].distance < kClearer * two[1].distance) {
      from.push_back(in_a[static_cast<std::size_t>(two[0].queryIdx)].pt);
      to.push_back(in_b[static_cast<std::size_t>(two[0].trainIdx)].pt);
    }
  constexpr std::size_t kFewest = 30;
  if (from.size() < kFewest) return {};
  std::vector<std::uint8_t> fits;
  constexpr double kRelief = 30;  // [px]
  if (cv::findHomography(from, to, cv::RANSAC, kRelief, fits).empty()) return {};
  std::vector<SamePlace> out;
  for (std::size_t k = 0; k < from.size(); ++k)
    if (fits[k] != 0) out.push_back({from[k], to[k]});
  return out.size() < kFewest ? std::vector<SamePlace>() : out;
}

}  // namespace

ImageOverlap measureOverlap(const std::filesystem::path& folder) {
  const std::vector<cv::Mat> images = readImages(folder);
  const int width = images.front().cols, height = images.front().rows;
  lighting::LightingModel model(width, height, PixelFormat::kRgb, 8, {});
  for (const cv::Mat& image : images) model.add(viewOf(image));
  std::vector<cv::Mat> corrected;
  std::vector<std::uint8_t> room(static_cast<std::size_t>(3 * width) * static_cast<std::size_t>(height));
  for (const cv::Mat& image : images) {
    corrected.emplace_back(height, width, CV_8UC3);
    model.colours(viewOf(image), lighting::RangeLattice(), room.data(), corrected.back().data);
  }
  ImageOverlap out;
  out.images = images.size();
  std::vector<topside::PlaceColours> before, after;
  const auto inside = [&](const cv::Point2f& p) {
    constexpr float kMargin = topside::kPlaceReach + 1;
    return p.x >= kMargin && p.y >= kMargin && p.x < static_cast<float>(width) - kMargin &&
           p.y < static_cast<float>(height) - kMargin;
  };
  for (std::size_t k = 0; k + 1 < images.size(); ++k) {
    const std::vector<SamePlace> places = samePlaces(images[k], images[k + 1]);
    out.couples += !places.empty();
    for (const SamePlace& place : places) {
      if (!inside(place.a) || !inside(place.b)) continue;
      const auto both = [&](const std::vector<cv::Mat>& of) -> topside::PlaceColours {
        return {topside::colourAbout(viewOf(of[k]), {place.a.x, place.a.y}),
                topside::colourAbout(viewOf(of[k + 1]), {place.b.x, place.b.y})};
      };
      before.push_back(both(images));
      after.push_back(both(corrected));
    }
  }
  out.places = before.size();
  if (before.empty()) return out;
  out.before = differenceOf(before);
  out.after = differenceOf(after);
  return out;
}

test::Report overlapReport() {
  struct Options {
    std::vector<std::filesystem::path> folders;
    std::filesystem::path out;
  };
  static Options o;
  return {"overlap",
          "How much a place's colour differs between images of a folder, as they came and corrected",
          {required({"folders", &o.folders, "folders of overlapping RGB images, in order of their names"}),
           {"--out", &o.out, "folder that gets overlap.html and overlap.json"}},
          [] {
            Page page("Colours of the same places in overlapping images");
            Table table{"",
                        {{"folder", 0},
                         {"images", 0},
                         {"couples", 0},
                         {"places", 0},
                         {"luminance [%]", 2},
                         {"corrected", 2},
                         {"chroma", 2},
                         {"corrected", 2}},
                        {}};
            for (const auto& folder : o.folders) {
              const ImageOverlap m = measureOverlap(folder);
              table.rows.push_back({folder.string(), cell(m.images), cell(m.couples), cell(m.places),
                                    100 * m.before.luminance, 100 * m.after.luminance, m.before.chroma,
                                    m.after.chroma});
            }
            page.add(std::move(table));
            std::printf("%s", page.text().c_str());
            if (!o.out.empty()) {
              std::filesystem::create_directories(o.out);
              page.write(o.out, "overlap");
            }
            return kExitSuccess;
          }};
}

}  // namespace fathom::bench
