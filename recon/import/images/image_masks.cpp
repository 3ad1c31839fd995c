#include "recon/import/images/image_masks.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/import/images/stereo_files.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;

// Full where the picture is lighter than half of full scale, in any channel.
cv::Mat shownBy(const fs::path& path, const Camera& camera) {
  const io::ImageFile file = io::readAnyImage(path);
  const ImageView& view = file.view;
  if (view.width != camera.width || view.height != camera.height)
    throw InputError(path.string(), "",
                     "is " + std::to_string(view.width) + "x" + std::to_string(view.height) +
                         " px; a mask has the size of its image, " + std::to_string(camera.width) + "x" +
                         std::to_string(camera.height));
  const int channels = view.format == PixelFormat::kRgb ? 3 : 1;
  const cv::Mat samples(view.height, view.width * channels, view.bits == 8 ? CV_8U : CV_16U,
                        const_cast<void*>(view.data), view.stride);
  const int half = ((1 << view.bits) - 1) / 2;
  cv::Mat light = samples > half;
  if (channels == 1) return light;
  cv::Mat lightest;
  cv::reduce(light.reshape(1, view.width * view.height), lightest, 1, cv::REDUCE_MAX);
  return lightest.reshape(1, view.height);
}

std::shared_ptr<const ImageMask> maskOf(const cv::Mat& shown) {
  auto mask = std::make_shared<ImageMask>();
  mask->width = shown.cols;
  mask->height = shown.rows;
  mask->clearance.resize(shown.total());
  cv::Mat out(shown.size(), CV_8U, mask->clearance.data());
  out.setTo(static_cast<double>(ImageMask::kFarthest));
  if (cv::countNonZero(shown) == static_cast<int>(shown.total())) return mask;
  cv::Mat distance;
  cv::distanceTransform(shown, distance, cv::DIST_L2, cv::DIST_MASK_5);
  distance.convertTo(out, CV_8U);
  return mask;
}

std::shared_ptr<const ImageMask> both(const ImageMask& a, const ImageMask& b) {
  auto mask = std::make_shared<ImageMask>(a);
  for (std::size_t k = 0; k < mask->clearance.size(); ++k)
    mask->clearance[k] = std::min(a.clearance[k], b.clearance[k]);
  return mask;
}

// left, right, colour, colour2 and so on; of others a large number.
std::size_t cameraNamed(const std::string& name) {
  constexpr std::string_view kColour = "colour";
  if (name == "left" || name == "right") return name == "left" ? 0 : 1;
  if (!name.starts_with(kColour)) return SIZE_MAX;
  const std::string number = name.substr(kColour.size());
  if (number.empty()) return 2;
  return number.size() == 1 && number[0] >= '2' && number[0] <= '9'
             ? static_cast<std::size_t>(number[0] - '0') + 1
             : SIZE_MAX;
}

std::string withoutEnding(const std::string& name) {
  return fs::path(name).replace_extension().generic_string();
}

}  // namespace

ImageMasks::ImageMasks(const fs::path& path, std::vector<Camera> cameras)
    : path_(path), cameras_(std::move(cameras)), all_files_(cameras_.size()), all_(cameras_.size()) {
  if (fs::is_regular_file(path)) {
    all_files_[0] = all_files_[1] = path;
  } else if (fs::is_directory(path)) {
    constexpr std::string_view kMask = "_mask";
    for (const fs::path& file : picturesIn(path)) {
      std::string name = withoutEnding(file.lexically_relative(path).generic_string());
      if (const std::size_t camera = cameraNamed(name); camera < cameras_.size()) {
        all_files_[camera] = file;
        continue;
      }
      if (name.ends_with(kMask)) name.resize(name.size() - kMask.size());
      single_[name] = file;
    }
  } else {
    throw InputError(path.string(), "", "is not there; give a picture, or a folder of masks");
  }
  for (std::size_t camera = 0; camera < cameras_.size(); ++camera) {
    if (all_files_[camera].empty()) continue;
    const cv::Mat shown = shownBy(all_files_[camera], cameras_[camera]);
    if (cv::countNonZero(shown) == 0)
      throw InputError(all_files_[camera].string(), "", "is black all over and hides the whole image");
    all_[camera] = maskOf(shown);
  }
  if (files().empty())
    throw InputError(
        path.string(), "",
        "holds no mask: left.png and right.png for all images, or NAME_mask.png for the image NAME");
}

fs::path ImageMasks::fileOf(const std::string& image) const {
  for (const std::string& name : {image, withoutEnding(image)})
    if (const auto found = single_.find(name); found != single_.end()) return found->second;
  return {};
}

std::vector<fs::path> ImageMasks::files() const {
  std::vector<fs::path> out;
  for (const fs::path& file : all_files_)
    if (!file.empty()) out.push_back(file);
  for (const auto& [name, file] : single_) out.push_back(file);
  return out;
}

std::shared_ptr<const ImageMask> ImageMasks::of(const std::string& image, std::size_t camera) const {
  const fs::path file = fileOf(image);
  if (file.empty()) return all_[camera];
  auto own = maskOf(shownBy(file, cameras_[camera]));
  return all_[camera] ? both(*own, *all_[camera]) : own;
}

void ImageMasks::requireUse(const PairList& list) const {
  if (files().size() > single_.size()) return;
  for (const ImagePair& pair : list.pairs) {
    if (!fileOf(pair.left).empty() || !fileOf(pair.right).empty()) return;
    for (const std::string& name : pair.colour)
      if (!fileOf(name).empty()) return;
  }
  const std::string first = withoutEnding(list.pairs.front().left);
  throw InputError(path_.string(), "",
                   "none of its " + std::to_string(single_.size()) + " masks is of an image of the dive; " +
                       list.pairs.front().left + " has " + first + "_mask.png");
}

void fillHidden(std::uint8_t* samples, int channels, const ImageMask& mask) {
  cv::Mat image(mask.height, mask.width, CV_8UC(channels), samples);
  const cv::Mat clearance(mask.height, mask.width, CV_8U, const_cast<std::uint8_t*>(mask.clearance.data()));
  const cv::Mat hidden = clearance == 0;
  if (cv::countNonZero(hidden) == 0) return;
  // Means of what is shown, each level of half the size filling the gaps of the one below (Burt 1988, "Moment
  // images, polynomial fit filters and the problem of surface interpolation").
  constexpr int kFirst = 8, kLast = 2;  // the first level's squares; the last level's side [px]
  cv::Mat shown = image.clone();
  shown.setTo(cv::Scalar::all(0), hidden);
  std::vector<cv::Mat> sums(1), weights(1);
  const cv::Size size(std::max(1, image.cols / kFirst), std::max(1, image.rows / kFirst));
  shown.convertTo(shown, CV_32F);
  cv::resize(shown, sums[0], size, 0, 0, cv::INTER_AREA);
  cv::Mat weight;
  cv::Mat(~hidden).convertTo(weight, CV_32F, 1.0 / 255);
  cv::resize(weight, weights[0], size, 0, 0, cv::INTER_AREA);
  while (std::min(sums.back().cols, sums.back().rows) > kLast) {
    cv::Mat sum, smaller;
    cv::pyrDown(sums.back(), sum);
    cv::pyrDown(weights.back(), smaller);
    sums.push_back(sum);
    weights.push_back(smaller);
  }
  cv::Mat filled;
  for (std::size_t k = sums.size(); k-- > 0;) {
    cv::Mat repeated, gap = 1 - weights[k];
    if (filled.empty()) {
      const cv::Scalar all = cv::sum(sums[k]) / std::max(cv::sum(weights[k])[0], 1e-6);
      filled = cv::Mat(sums[k].size(), sums[k].type(), all);
    } else {
      cv::pyrUp(filled, filled, sums[k].size());
    }
    cv::merge(std::vector<cv::Mat>(static_cast<std::size_t>(channels), gap), repeated);
    filled = sums[k] + filled.mul(repeated);
  }
  cv::Mat large;
  cv::resize(filled, large, image.size(), 0, 0, cv::INTER_LINEAR);
  large.convertTo(large, CV_8U);
  large.copyTo(image, hidden);
}

}  // namespace fathom::topside
