#include "recon/products/rasters/srgb_profile.hpp"

#include <lcms2.h>

#include <algorithm>
#include <stdexcept>

namespace fathom::topside {

const std::vector<std::uint8_t>& srgbProfile() {
  static const std::vector<std::uint8_t> bytes = [] {
    cmsHPROFILE profile = cmsCreate_sRGBProfile();
    cmsUInt32Number size = 0;
    std::vector<std::uint8_t> out;
    bool good = profile != nullptr && cmsSaveProfileToMem(profile, nullptr, &size) != 0;
    if (good) {
      out.resize(size);
      good = cmsSaveProfileToMem(profile, out.data(), &size) != 0;
    }
    if (profile != nullptr) cmsCloseProfile(profile);
    if (!good) throw std::runtime_error("LittleCMS makes no sRGB profile");
    // Its date of creation, six numbers of 16 bits (ICC.1:2010, 7.2.8), is today's: results of a run would
    // differ from day to day. The day of ICC.1:2010 instead.
    constexpr std::size_t kDate = 24;
    constexpr std::uint8_t kYearHigh = 2010 / 256, kYearLow = 2010 % 256;
    const std::uint8_t date[12] = {kYearHigh, kYearLow, 0, 12, 0, 1, 0, 0, 0, 0, 0, 0};
    std::copy_n(date, sizeof date, &out.at(kDate));
    return out;
  }();
  return bytes;
}

}  // namespace fathom::topside
