#include "recon/products/rasters/cog_writer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <optional>
#include <stdexcept>

#include "realtime/base/files/atomic_file.hpp"
#include "recon/products/rasters/block_codec.hpp"
#include "recon/products/rasters/tiff_head.hpp"

namespace fathom::topside {
namespace {

constexpr std::size_t kBlockCells = static_cast<std::size_t>(kCogBlock) * kCogBlock;
constexpr std::uint64_t kClassicBytes = 0xFFFFFFF0U;  // a longer file needs BigTIFF

// One block's cells, top row first; floats or RGBA.
struct Block {
  std::vector<float> values;
  std::vector<std::uint8_t> rgba;
};

// Encoded blocks in transit to the file, in the order in which they come.
class BlockFile {
 public:
  explicit BlockFile(const std::filesystem::path& path)
      : path_(path), file_(path, std::ios::binary | std::ios::in | std::ios::out | std::ios::trunc) {
    if (!file_) throw std::runtime_error(path.string() + ": cannot be written");
  }
  ~BlockFile() {
    file_.close();
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
  }
  BlockFile(const BlockFile&) = delete;
  BlockFile& operator=(const BlockFile&) = delete;

  // Where it begins.
  std::uint64_t append(const std::vector<std::uint8_t>& bytes) {
    const std::uint64_t at = end_;
    file_.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    if (!file_) throw std::runtime_error(path_.string() + ": cannot be written; is the disk full?");
    end_ += bytes.size();
    return at;
  }
  void read(std::uint64_t at, std::vector<char>& bytes) {
    file_.seekg(static_cast<std::streamoff>(at));
    file_.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    if (!file_) throw std::runtime_error(path_.string() + ": cannot be read back");
  }

 private:
  std::filesystem::path path_;
  std::fstream file_;
  std::uint64_t end_ = 0;
};

class Pyramid {
 public:
  Pyramid(const RasterSource& source, const CogOptions& options, BlockFile& file)
      : source_(source), options_(options), file_(file), codec_(kCogBlock) {
    auto width = static_cast<std::uint32_t>(source.extent.columns),
         height = static_cast<std::uint32_t>(source.extent.rows);
    for (;;) {
      TiffLevel level{width, height, {}, {}};
      level.offsets.assign(std::size_t{across(width)} * across(height), 0);
      level.sizes.assign(level.offsets.size(), 0);
      levels_.push_back(std::move(level));
      if (width <= kCogBlock && height <= kCogBlock) break;
      width = (width + 1) / 2;
      height = (height + 1) / 2;
    }
    (void)make(levels_.size() - 1, 0, 0);
  }
  // Offsets are those in the block file; blocks without data have no bytes.
  [[nodiscard]] const std::vector<TiffLevel>& levels() const { return levels_; }

 private:
  static std::uint32_t across(std::uint32_t pixels) { return (pixels + kCogBlock - 1) / kCogBlock; }

  // The finest cells under a block.
  [[nodiscard]] CellWindow windowOf(std::size_t level, std::uint32_t bx, std::uint32_t by) const {
    const std::int64_t edge = std::int64_t{kCogBlock} << level;
    const std::int64_t x0 = bx * edge, y0 = by * edge;
    const auto columns = static_cast<std::int32_t>(std::min<std::int64_t>(edge, source_.extent.columns - x0));
    const auto rows = static_cast<std::int32_t>(std::min<std::int64_t>(edge, source_.extent.rows - y0));
    return {static_cast<std::int32_t>(source_.extent.x + source_.extent.rows - y0 - rows),
            static_cast<std::int32_t>(source_.extent.y + x0), rows, columns};
  }

  // Makes a block of a level and all below it; none where there is no data.
  std::optional<Block> make(std::size_t level, std::uint32_t bx, std::uint32_t by) {
    const CellWindow window = windowOf(level, bx, by);
    if (!source_.touches(window)) return std::nullopt;
    std::optional<Block> block = level == 0 ? read(window) : reduced(level, bx, by);
    if (block) {
      TiffLevel& to = levels_[level];
      const std::size_t at = std::size_t{by} * across(to.width) + bx;
      const std::vector<std::uint8_t> bytes = encoded(*block);
      to.offsets[at] = file_.append(bytes);
      to.sizes[at] = static_cast<std::uint32_t>(bytes.size());
    }
    return block;
  }

  std::vector<std::uint8_t> encoded(const Block& block) {
    if (!source_.colour) return codec_.floats(block.values);
    return options_.quality > 0 ? codec_.coloursWebp(block.rgba, options_.quality)
                                : codec_.coloursDeflated(block.rgba);
  }

  [[nodiscard]] Block empty() const {
    Block block;
    if (source_.colour)
      block.rgba.assign(4 * kBlockCells, 0);
    else
      block.values.assign(kBlockCells, std::numeric_limits<float>::quiet_NaN());
    return block;
  }

  [[nodiscard]] std::optional<Block> read(const CellWindow& window) const {
    Block block = empty();
    bool any = false;
    const auto flip = [&](const auto& cells, auto& to, std::size_t samples, auto known) {
      for (std::int32_t row = 0; row < window.rows; ++row) {
        const auto* from = &cells[samples * window.at(window.rows - 1 - row, 0)];
        const std::size_t count = samples * static_cast<std::size_t>(window.columns);
        std::copy_n(from, count, &to[samples * kCogBlock * static_cast<std::size_t>(row)]);
        for (std::size_t k = 0; k < count && !any; k += samples) any = known(from + k);
      }
    };
    if (source_.colour) {
      std::vector<std::uint8_t> cells(4 * window.cells());
      source_.fill(window, cells.data());
      flip(cells, block.rgba, 4, [](const std::uint8_t* c) { return c[3] != 0; });
    } else {
      std::vector<float> cells(window.cells());
      source_.fill(window, cells.data());
      flip(cells, block.values, 1, [](const float* v) { return !std::isnan(*v); });
    }
    if (!any) return std::nullopt;
    return block;
  }

  std::optional<Block> reduced(std::size_t level, std::uint32_t bx, std::uint32_t by) {
    const TiffLevel& below = levels_[level - 1];
    std::optional<Block> block;
    for (std::uint32_t k = 0; k < 4; ++k) {
      const std::uint32_t cx = 2 * bx + k % 2, cy = 2 * by + k / 2;
      if (cx >= across(below.width) || cy >= across(below.height)) continue;
      const std::optional<Block> child = make(level - 1, cx, cy);
      if (!child) continue;
      if (!block) block = empty();
      halve(*child, k % 2, k / 2, *block);
    }
    return block;
  }

  // Into a quarter of its parent.
  void halve(const Block& child, std::uint32_t right, std::uint32_t down, Block& parent) const {
    constexpr std::size_t kHalf = kCogBlock / 2;
    for (std::size_t y = 0; y < kHalf; ++y) {
      for (std::size_t x = 0; x < kHalf; ++x) {
        const std::size_t to = (y + down * kHalf) * kCogBlock + x + right * kHalf;
        const std::size_t from = 2 * y * kCogBlock + 2 * x;
        const std::array<std::size_t, 4> four = {from, from + 1, from + kCogBlock, from + kCogBlock + 1};
        if (source_.colour)
          meanColour(child.rgba, four, &parent.rgba[4 * to]);
        else
          parent.values[to] = options_.average ? meanValue(child.values, four) : oneOf(child.values, four);
      }
    }
  }
  static void meanColour(const std::vector<std::uint8_t>& rgba, const std::array<std::size_t, 4>& four,
                         std::uint8_t* to) {
    std::array<unsigned, 3> sum{};
    unsigned known = 0;
    for (const std::size_t k : four) {
      if (rgba[4 * k + 3] == 0) continue;
      ++known;
      for (std::size_t c = 0; c < 3; ++c) sum[c] += rgba[4 * k + c];
    }
    if (known == 0) return;
    for (std::size_t c = 0; c < 3; ++c) to[c] = static_cast<std::uint8_t>((sum[c] + known / 2) / known);
    to[3] = 255;
  }
  static float meanValue(const std::vector<float>& values, const std::array<std::size_t, 4>& four) {
    float sum = 0, known = 0;
    for (const std::size_t k : four)
      if (!std::isnan(values[k])) sum += values[k], known += 1;
    return known > 0 ? sum / known : std::numeric_limits<float>::quiet_NaN();
  }
  static float oneOf(const std::vector<float>& values, const std::array<std::size_t, 4>& four) {
    for (const std::size_t k : four)
      if (!std::isnan(values[k])) return values[k];
    return std::numeric_limits<float>::quiet_NaN();
  }

  const RasterSource& source_;
  const CogOptions& options_;
  BlockFile& file_;
  BlockCodec codec_;
  std::vector<TiffLevel> levels_;
};

// Positions of the blocks: the coarsest level first, so that an overview is near the file's beginning.
std::vector<TiffLevel> placed(std::vector<TiffLevel> levels, std::uint64_t begin, std::uint64_t& end) {
  constexpr std::uint64_t kAround = 8;  // size before, last four bytes again behind
  end = begin;
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) {
    for (std::size_t k = 0; k < level->sizes.size(); ++k) {
      if (level->sizes[k] == 0) continue;
      level->offsets[k] = end + 4;
      end += level->sizes[k] + kAround;
    }
  }
  return levels;
}

}  // namespace

void writeCog(const std::filesystem::path& path, const RasterSource& source, const CogOptions& options) {
  std::filesystem::path waiting = path;
  waiting += ".blocks.tmp";
  BlockFile blocks(waiting);
  const Pyramid pyramid(source, options, blocks);

  TiffRaster raster;
  raster.colour = source.colour;
  raster.compression =
      source.colour && options.quality > 0 ? TiffCompression::kWebp : TiffCompression::kDeflate;
  raster.block = kCogBlock;
  raster.cell = source.cell;
  raster.north = (source.extent.x + source.extent.rows) * source.cell;
  raster.west = source.extent.y * source.cell;
  raster.origin = options.origin;
  raster.description = options.description;
  raster.unit = options.unit;

  std::uint64_t end = 0;
  std::vector<TiffLevel> levels =
      placed(pyramid.levels(), tiffHead(raster, pyramid.levels(), true).size(), end);
  const bool big = end > kClassicBytes;
  if (!big) levels = placed(pyramid.levels(), tiffHead(raster, pyramid.levels(), false).size(), end);

  AtomicFile file(path);
  const std::vector<std::uint8_t> head = tiffHead(raster, levels, big);
  file.stream().write(reinterpret_cast<const char*>(head.data()), static_cast<std::streamsize>(head.size()));
  std::vector<char> bytes;
  for (std::size_t l = levels.size(); l-- > 0;) {
    for (std::size_t k = 0; k < levels[l].sizes.size(); ++k) {
      const std::uint32_t size = levels[l].sizes[k];
      if (size == 0) continue;
      bytes.resize(size);
      blocks.read(pyramid.levels()[l].offsets[k], bytes);
      file.stream().write(reinterpret_cast<const char*>(&size), sizeof size);
      file.stream().write(bytes.data(), size);
      file.stream().write(bytes.data() + size - 4, 4);
    }
  }
  file.commit();
}

}  // namespace fathom::topside
