// A rendered mission as a diver's camera leaves it: folders left/ and right/ of numbered pictures of 8 bits,
// PNG, JPEG and TIFF, with the calibration beside them.
//   folder_dive MISSION FOLDER
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace fs = std::filesystem;

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: folder_dive MISSION FOLDER\n");
    return 2;
  }
  const fs::path mission = argv[1], dive = argv[2];
  fs::remove_all(dive);
  for (const auto& [side, camera] : {std::pair("left", "_LC16.tif"), std::pair("right", "_RM16.tif")}) {
    fs::create_directories(dive / side);
    std::vector<fs::path> images;
    for (const auto& entry : fs::directory_iterator(mission / "img"))
      if (entry.path().string().ends_with(camera)) images.push_back(entry.path());
    std::sort(images.begin(), images.end());
    for (std::size_t k = 0; k < images.size(); ++k) {
      cv::Mat image = cv::imread(images[k].string(), cv::IMREAD_UNCHANGED);
      if (camera[1] == 'L') cv::cvtColor(image, image, cv::COLOR_BayerBG2BGR);
      constexpr double kGamma = 1 / 2.2, kBright = 4;  // lamps are weak
      image.convertTo(image, CV_32F, kBright / 4095);
      cv::pow(image, kGamma, image);
      image.convertTo(image, CV_8U, 255);
      constexpr const char* kEndings[] = {".png", ".jpg", ".tif"};
      cv::imwrite((dive / side / (std::to_string(k + 1) + kEndings[k % 3])).string(), image);
    }
  }
  fs::copy_file(mission / "stereo.calib", dive / "stereo.calib");
  return 0;
}
