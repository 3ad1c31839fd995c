#pragma once

#include <cstdint>
#include <memory>
#include <vector>

struct libdeflate_compressor;

namespace fathom::topside {

// Compresses blocks of a TIFF, edge x edge cells each. One object a thread.
class BlockCodec {
 public:
  explicit BlockCodec(int edge);
  ~BlockCodec();
  BlockCodec(const BlockCodec&) = delete;
  BlockCodec& operator=(const BlockCodec&) = delete;

  // Deflate with the floating-point predictor (TIFF Technical Note 3).
  [[nodiscard]] std::vector<std::uint8_t> floats(const std::vector<float>& block);
  // RGBA: deflate with horizontal differences (TIFF 6.0, section 14), or WebP with lossless alpha.
  [[nodiscard]] std::vector<std::uint8_t> coloursDeflated(const std::vector<std::uint8_t>& rgba);
  [[nodiscard]] std::vector<std::uint8_t> coloursWebp(const std::vector<std::uint8_t>& rgba,
                                                      int quality) const;

 private:
  [[nodiscard]] std::vector<std::uint8_t> deflated(const std::vector<std::uint8_t>& raw);

  std::size_t edge_;
  libdeflate_compressor* compressor_;
};

}  // namespace fathom::topside
