#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "recon/stereo/sparse_stereo.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::stereo {
namespace {

struct FloatArray {
  int rows = 0, columns = 0;
  std::vector<float> values;
  [[nodiscard]] float at(int row, int column) const {
    return values[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                  static_cast<std::size_t>(column)];
  }
};

std::uint32_t number(const std::string& bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = size; i-- > 0;) value = value << 8 | static_cast<std::uint8_t>(bytes.at(at + i));
  return value;
}

// Content of the archive's first file. Sizes come from the central directory: the local header may leave
// them out.
std::string firstFile(const std::string& zip) {
  constexpr std::uint32_t kDirectoryEnd = 0x06054b50;
  std::size_t end = zip.size() >= 22 ? zip.size() - 22 : 0;
  while (end > 0 && number(zip, end, 4) != kDirectoryEnd) --end;
  if (end == 0) throw std::runtime_error("not a zip archive");
  const std::size_t directory = number(zip, end + 16, 4);
  const std::uint32_t method = number(zip, directory + 10, 2);
  const std::uint32_t packed = number(zip, directory + 20, 4), size = number(zip, directory + 24, 4);
  const std::size_t local = number(zip, directory + 42, 4);
  const std::size_t data = local + 30 + number(zip, local + 26, 2) + number(zip, local + 28, 2);
  if (method == 0) return zip.substr(data, size);
  std::string content(size, '\0');
  z_stream stream{};
  if (method != 8 || inflateInit2(&stream, -MAX_WBITS) != Z_OK)
    throw std::runtime_error("unknown compression");
  std::string input = zip.substr(data, packed);
  stream.next_in = reinterpret_cast<Bytef*>(input.data());
  stream.avail_in = packed;
  stream.next_out = reinterpret_cast<Bytef*>(content.data());
  stream.avail_out = size;
  const int status = inflate(&stream, Z_FINISH);
  inflateEnd(&stream);
  if (status != Z_STREAM_END) throw std::runtime_error("damaged zip archive");
  return content;
}

// The first array of a .npz file (a zip of .npy), which must be two-dimensional little-endian float32 in C
// order, stored or deflated. Throws std::runtime_error for anything else.
FloatArray readNpz(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string npy = firstFile({std::istreambuf_iterator<char>(in), {}});
  const std::size_t header = number(npy, 8, 2);
  const std::string text = npy.substr(10, header);
  const std::size_t shape = text.find("'shape': (");
  FloatArray array;
  if (text.find("'<f4'") == std::string::npos || text.find("'fortran_order': False") == std::string::npos ||
      shape == std::string::npos ||
      std::sscanf(text.c_str() + shape, "'shape': (%d, %d)", &array.rows, &array.columns) != 2)
    throw std::runtime_error("not a two-dimensional float32 array");
  array.values.resize(static_cast<std::size_t>(array.rows) * static_cast<std::size_t>(array.columns));
  if (npy.size() != 10 + header + array.values.size() * sizeof(float))
    throw std::runtime_error("array is cut");
  std::memcpy(array.values.data(), npy.data() + 10 + header, array.values.size() * sizeof(float));
  return array;
}

ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, image.step, PixelFormat::kMono, 8};
}

// Middlebury 2014 Motorcycle, quarter size (Scharstein et al.): a rectified pair, left(x) matches right(x -
// d), and Z = f B / (d + doffs), so that the right camera's centre is doffs to the right of the left's.
TEST(Middlebury, MotorcycleDisparitiesAgreeWithTheTruth) {
  FATHOM_REQUIRE_DATA("stereo/motorcycle_left.png");
  constexpr double kFocal = 994.978, kCx = 311.193, kCy = 254.877, kDoffs = 31.086;  // [px]
  constexpr double kBaseline = 0.193001;                                             // [m]
  const cv::Mat left = cv::imread(test::dataFile("stereo/motorcycle_left.png"), cv::IMREAD_GRAYSCALE);
  const cv::Mat right = cv::imread(test::dataFile("stereo/motorcycle_right.png"), cv::IMREAD_GRAYSCALE);
  const FloatArray truth = readNpz(test::dataFile("stereo/motorcycle_disp.npz"));
  ASSERT_EQ(truth.rows, left.rows);
  ASSERT_EQ(truth.columns, left.cols);

  StereoRig rig;
  rig.left = {left.cols, left.rows, kFocal, kFocal, kCx, kCy};
  rig.right = rig.left;
  rig.right.cx += kDoffs;
  rig.T_right_left = SE3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), {-kBaseline, 0, 0});
  SparseStereoConfig config;
  config.max_features = 5000;  // all else as on the seafloor
  SparseStereo stereo(rig, config);
  // A workshop, not a seafloor: most of it is about three metres away, no more is known.
  const StereoResult& result = stereo.process(viewOf(left), viewOf(right), {Eigen::Vector3d::UnitZ(), 2.9});

  std::vector<double> errors;
  for (const StereoPoint& p : result.points) {
    const double d = static_cast<double>(
        truth.at(static_cast<int>(std::lround(p.left.y())), static_cast<int>(std::lround(p.left.x()))));
    if (std::isfinite(d)) errors.push_back(std::abs(static_cast<double>(p.left.x() - p.right.x()) - d));
  }
  std::sort(errors.begin(), errors.end());
  ASSERT_GE(errors.size(), 2000U);
  const double median = errors[errors.size() / 2];
  const double bad =
      static_cast<double>(std::count_if(errors.begin(), errors.end(), [](double e) { return e > 1; })) /
      static_cast<double>(errors.size());
  std::printf("%zu points with truth, median %.3f px, beyond 1 px %.2f %%\n", errors.size(), median,
              100 * bad);
  EXPECT_LE(median, 0.15);
  EXPECT_LE(bad, 0.03);
}

}  // namespace
}  // namespace fathom::stereo
