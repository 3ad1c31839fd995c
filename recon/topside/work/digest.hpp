#pragma once

#include <array>
#include <compare>
#include <concepts>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace fathom::topside {

using Bytes = std::vector<std::uint8_t>;

// BLAKE2b-256 of some bytes.
struct Digest {
  std::array<std::uint8_t, 32> bytes{};
  auto operator<=>(const Digest&) const = default;
  [[nodiscard]] std::string hex() const;       // 64 digits
  [[nodiscard]] std::string shortHex() const;  // the first 16: for names of files
};

// Digests what is given to it, each thing so that no two lists of things look alike: texts and blocks with
// their length. The same on every machine of this kind (little endian, IEEE 754).
class Hasher {
 public:
  Hasher();

  template <typename... T>
  Hasher& add(const T&... values) {
    (one(values), ...);
    return *this;
  }
  Hasher& raw(const void* data, std::size_t count);  // without its length
  [[nodiscard]] Digest finish();                     // once

 private:
  template <typename T>
  requires(std::is_arithmetic_v<T> || std::is_enum_v<T>) void one(const T& value) {
    raw(&value, sizeof value);
  }
  void one(std::string_view text);
  void one(const char* text) { one(std::string_view(text)); }
  void one(const std::string& text) { one(std::string_view(text)); }
  void one(const Digest& digest) { raw(digest.bytes.data(), digest.bytes.size()); }
  void one(std::span<const std::uint8_t> block);
  void one(const Bytes& block) { one(std::span<const std::uint8_t>(block)); }

  // crypto_generichash_state of libsodium, which wants 64 bytes of alignment.
  struct alignas(64) State {
    std::array<std::uint8_t, 384> bytes;
  } state_;
};

[[nodiscard]] Digest digestOf(std::span<const std::uint8_t> bytes);
// Of a file's content, read in parts; throws InputError when it cannot be read.
[[nodiscard]] Digest digestOfFile(const std::filesystem::path& path);
// Of a folder's files below it, names and contents, in the order of their names, but `except` (relative
// names).
[[nodiscard]] Digest digestOfFolder(const std::filesystem::path& folder,
                                    std::span<const std::string_view> except);

}  // namespace fathom::topside
