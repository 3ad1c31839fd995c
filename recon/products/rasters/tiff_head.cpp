#include "recon/products/rasters/tiff_head.hpp"

#include <lcms2.h>
#include <libdeflate.h>
#include <webp/encode.h>
#include <algorithm>
#include <bit>
#include <stdexcept>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/products/rasters/block_codec.hpp"
#include "recon/products/rasters/srgb_profile.hpp"

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

namespace {

constexpr int kDeflateLevel = 4;  // the last that is fast: level 6 takes twice the time for 3 % less
constexpr int kWebpMethod = 1;    // of 0 to 6: 4, the default, takes three times as long for 5 % less

struct Picture {
  WebPPicture webp;
  Picture() {
    if (WebPPictureInit(&webp) == 0) throw std::runtime_error("this libwebp is another version's");
  }
  ~Picture() { WebPPictureFree(&webp); }
  Picture(const Picture&) = delete;
  Picture& operator=(const Picture&) = delete;
};

int append(const std::uint8_t* data, std::size_t size, const WebPPicture* picture) {
  auto* out = static_cast<std::vector<std::uint8_t>*>(picture->custom_ptr);
  out->insert(out->end(), data, data + size);
  return 1;
}

}  // namespace

BlockCodec::BlockCodec(int edge)
    : edge_(static_cast<std::size_t>(edge)), compressor_(libdeflate_alloc_compressor(kDeflateLevel)) {
  if (compressor_ == nullptr) throw std::bad_alloc();
}
BlockCodec::~BlockCodec() {
  libdeflate_free_compressor(compressor_);
}

std::vector<std::uint8_t> BlockCodec::deflated(const std::vector<std::uint8_t>& raw) {
  std::vector<std::uint8_t> out(libdeflate_zlib_compress_bound(compressor_, raw.size()));
  const std::size_t size =
      libdeflate_zlib_compress(compressor_, raw.data(), raw.size(), out.data(), out.size());
  if (size == 0) throw std::runtime_error("a block of a raster does not deflate");
  out.resize(size);
  return out;
}

std::vector<std::uint8_t> BlockCodec::floats(const std::vector<float>& block) {
  constexpr std::size_t kBytes = sizeof(float);
  std::vector<std::uint8_t> raw(kBytes * block.size());
  for (std::size_t row = 0; row < edge_; ++row) {
    std::uint8_t* to = &raw[row * edge_ * kBytes];
    for (std::size_t x = 0; x < edge_; ++x) {
      const auto bits = std::bit_cast<std::uint32_t>(block[row * edge_ + x]);
      for (std::size_t k = 0; k < kBytes; ++k)  // planes, the highest byte's first
        to[k * edge_ + x] = static_cast<std::uint8_t>(bits >> (8 * (kBytes - 1 - k)));
    }
    for (std::size_t k = kBytes * edge_ - 1; k > 0; --k) to[k] = static_cast<std::uint8_t>(to[k] - to[k - 1]);
  }
  return deflated(raw);
}

std::vector<std::uint8_t> BlockCodec::coloursDeflated(const std::vector<std::uint8_t>& rgba) {
  std::vector<std::uint8_t> raw = rgba;
  for (std::size_t row = 0; row < edge_; ++row) {
    std::uint8_t* to = &raw[row * edge_ * 4];
    for (std::size_t k = 4 * edge_ - 1; k >= 4; --k) to[k] = static_cast<std::uint8_t>(to[k] - to[k - 4]);
  }
  return deflated(raw);
}

std::vector<std::uint8_t> BlockCodec::coloursWebp(const std::vector<std::uint8_t>& rgba, int quality) const {
  WebPConfig config;
  if (WebPConfigPreset(&config, WEBP_PRESET_DEFAULT, static_cast<float>(quality)) == 0)
    throw std::runtime_error("WebP quality must be between 0 and 100");
  config.method = kWebpMethod;
  std::vector<std::uint8_t> out;
  Picture picture;
  const int edge = static_cast<int>(edge_);
  picture.webp.width = picture.webp.height = edge;
  picture.webp.writer = append;
  picture.webp.custom_ptr = &out;
  if (WebPPictureImportRGBA(&picture.webp, rgba.data(), 4 * edge) == 0 ||
      WebPEncode(&config, &picture.webp) == 0)
    throw std::runtime_error("a block of the orthomosaic cannot be encoded as WebP");
  return out;
}

namespace {

// After this line come so many bytes; blocks have their size before them and their last bytes again behind.
constexpr const char* kLayout =
    "GDAL_STRUCTURAL_METADATA_SIZE=000140 bytes\n"
    "LAYOUT=IFDS_BEFORE_DATA\nBLOCK_ORDER=ROW_MAJOR\nBLOCK_LEADER=SIZE_AS_UINT4\n"
    "BLOCK_TRAILER=LAST_4_BYTES_REPEATED\nKNOWN_INCOMPATIBLE_EDITION=NO\n ";

enum Type : std::uint16_t { kAscii = 2, kShort = 3, kLong = 4, kBytes = 7, kDouble = 12, kLong8 = 16 };

template <typename T>
void put(std::vector<std::uint8_t>& bytes, T value) {
  const auto* from = reinterpret_cast<const std::uint8_t*>(&value);  // little endian, as the file says
  bytes.insert(bytes.end(), from, from + sizeof value);
}

struct Entry {
  std::uint16_t tag, type;
  std::uint64_t count;
  std::vector<std::uint8_t> bytes;
};

// One directory; tags must be added in ascending order.
class Directory {
 public:
  template <typename T>
  void add(std::uint16_t tag, Type type, const std::vector<T>& values) {
    Entry entry{tag, type, values.size(), {}};
    for (const T value : values) put(entry.bytes, value);
    entries_.push_back(std::move(entry));
  }
  void shorts(std::uint16_t tag, const std::vector<std::uint16_t>& values) { add(tag, kShort, values); }
  void number(std::uint16_t tag, std::uint32_t value) { add(tag, kLong, std::vector{value}); }
  void doubles(std::uint16_t tag, const std::vector<double>& values) { add(tag, kDouble, values); }
  void text(std::uint16_t tag, const std::string& value) {
    add(tag, kAscii, std::vector<char>(value.c_str(), value.c_str() + value.size() + 1));
  }

  // The directory at the end of `file`, and behind it the values that do not fit into it.
  void write(std::vector<std::uint8_t>& file, bool big, bool last) const {
    const std::size_t word = big ? 8 : 4;
    file.resize((file.size() + 7) / 8 * 8);
    const std::size_t end = file.size() + (big ? 8 : 2) + entries_.size() * (big ? 20 : 12) + word;
    std::vector<std::uint8_t> values;
    const auto offset = [&](std::uint64_t at) {
      if (big)
        put(file, at);
      else
        put(file, static_cast<std::uint32_t>(at));
    };
    if (big)
      put(file, static_cast<std::uint64_t>(entries_.size()));
    else
      put(file, static_cast<std::uint16_t>(entries_.size()));
    for (const Entry& entry : entries_) {
      put(file, entry.tag);
      put(file, entry.type);
      offset(entry.count);
      if (entry.bytes.size() <= word) {
        file.insert(file.end(), entry.bytes.begin(), entry.bytes.end());
        file.resize(file.size() + word - entry.bytes.size());
        continue;
      }
      offset(end + values.size());
      values.insert(values.end(), entry.bytes.begin(), entry.bytes.end());
      values.resize((values.size() + 7) / 8 * 8);
    }
    offset(last ? 0 : (end + values.size() + 7) / 8 * 8);
    file.insert(file.end(), values.begin(), values.end());
  }

 private:
  std::vector<Entry> entries_;
};

// GeoTIFF keys (OGC 19-008r4, and annex of geographic keys) of a transverse Mercator on WGS84.
void addGeoKeys(const TiffRaster& raster, Directory& directory) {
  constexpr std::uint16_t kUserDefined = 32767, kDoubles = 34736, kTexts = 34737;
  const std::string name = "Local transverse Mercator (dive origin)|";
  const auto length = static_cast<std::uint16_t>(name.size());
  directory.shorts(34735, {1,    1,        0,      15,            // version, how many keys
                           1024, 0,        1,      1,             // model: projected
                           1025, 0,        1,      1,             // a pixel is an area
                           1026, kTexts,   length, 0,             // citation
                           2048, 0,        1,      4326,          // geographic: WGS84
                           2054, 0,        1,      9102,          // angles: degrees
                           3072, 0,        1,      kUserDefined,  // projected system: its own
                           3073, kTexts,   length, 0,             // and its name
                           3074, 0,        1,      kUserDefined,  // projection
                           3075, 0,        1,      1,             // transverse Mercator
                           3076, 0,        1,      9001,          // lengths: metres
                           3080, kDoubles, 1,      0,             // longitude of origin
                           3081, kDoubles, 1,      1,             // latitude
                           3082, kDoubles, 1,      3,             // false easting
                           3083, kDoubles, 1,      4,             // and northing
                           3092, kDoubles, 1,      2});           // scale at the origin
  directory.doubles(kDoubles, {raster.origin->longitude * kDegreesPerRadian,
                               raster.origin->latitude * kDegreesPerRadian, 1, 0, 0});
  directory.text(kTexts, name);
}

Directory directoryOf(const TiffRaster& raster, const TiffLevel& level, bool finest, bool big) {
  constexpr std::uint16_t kPredictDifferences = 2, kPredictFloats = 3, kAlpha = 2, kFloats = 3;
  Directory out;
  out.number(254, finest ? 0 : 1);  // a reduced version of another
  out.number(256, level.width);
  out.number(257, level.height);
  out.shorts(258, raster.colour ? std::vector<std::uint16_t>{8, 8, 8, 8} : std::vector<std::uint16_t>{32});
  out.shorts(259, {static_cast<std::uint16_t>(raster.compression)});
  out.shorts(262, {static_cast<std::uint16_t>(raster.colour ? 2 : 1)});  // RGB, or black is zero
  out.shorts(277, {static_cast<std::uint16_t>(raster.colour ? 4 : 1)});
  out.shorts(284, {1});  // samples of a pixel together
  if (raster.compression == TiffCompression::kDeflate)
    out.shorts(317, {raster.colour ? kPredictDifferences : kPredictFloats});
  out.number(322, static_cast<std::uint32_t>(raster.block));
  out.number(323, static_cast<std::uint32_t>(raster.block));
  if (big) {
    out.add(324, kLong8, level.offsets);
  } else {
    out.add(324, kLong, std::vector<std::uint32_t>(level.offsets.begin(), level.offsets.end()));
  }
  out.add(325, kLong, level.sizes);
  if (raster.colour) out.shorts(338, {kAlpha});
  out.shorts(339,
             raster.colour ? std::vector<std::uint16_t>{1, 1, 1, 1} : std::vector<std::uint16_t>{kFloats});
  if (finest) {
    out.doubles(33550, {raster.cell, raster.cell, 0});
    out.doubles(33922, {0, 0, 0, raster.west, raster.north, 0});
    if (raster.colour) out.add(34675, kBytes, srgbProfile());
    if (raster.origin) addGeoKeys(raster, out);
  }
  if (finest && !raster.colour)
    out.text(42112, "<GDALMetadata>\n  <Item name=\"DESCRIPTION\" sample=\"0\" role=\"description\">" +
                        markupText(raster.description) +
                        "</Item>\n  <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">" +
                        markupText(raster.unit) + "</Item>\n</GDALMetadata>\n");
  if (!raster.colour) out.text(42113, "nan");
  return out;
}

}  // namespace

std::vector<std::uint8_t> tiffHead(const TiffRaster& raster, const std::vector<TiffLevel>& levels, bool big) {
  std::vector<std::uint8_t> file = {'I', 'I'};
  const std::string layout = kLayout;
  const std::size_t header = big ? 16 : 8;
  const std::size_t first = (header + layout.size() + 7) / 8 * 8;
  put(file, static_cast<std::uint16_t>(big ? 43 : 42));
  if (big) {
    put(file, static_cast<std::uint16_t>(8));
    put(file, static_cast<std::uint16_t>(0));
    put(file, static_cast<std::uint64_t>(first));
  } else {
    put(file, static_cast<std::uint32_t>(first));
  }
  file.insert(file.end(), layout.begin(), layout.end());
  file.resize(first);
  for (std::size_t k = 0; k < levels.size(); ++k)
    directoryOf(raster, levels[k], k == 0, big).write(file, big, k + 1 == levels.size());
  return file;
}

}  // namespace fathom::topside
