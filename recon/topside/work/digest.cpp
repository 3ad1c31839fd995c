#include "recon/topside/work/digest.hpp"

#include <sodium.h>

#include <algorithm>
#include <fstream>

#include "realtime/base/input_error.hpp"

namespace fathom::topside {

std::string Digest::hex() const {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

std::string Digest::shortHex() const {
  return hex().substr(0, 16);
}

Hasher::Hasher() {
  static_assert(sizeof(crypto_generichash_state) <= sizeof(State));
  crypto_generichash_init(reinterpret_cast<crypto_generichash_state*>(&state_), nullptr, 0,
                          sizeof(Digest::bytes));
}

Hasher& Hasher::raw(const void* data, std::size_t count) {
  crypto_generichash_update(reinterpret_cast<crypto_generichash_state*>(&state_),
                            static_cast<const unsigned char*>(data), count);
  return *this;
}

void Hasher::one(std::string_view text) {
  one(static_cast<std::uint64_t>(text.size()));
  raw(text.data(), text.size());
}

void Hasher::one(std::span<const std::uint8_t> block) {
  one(static_cast<std::uint64_t>(block.size()));
  raw(block.data(), block.size());
}

Digest Hasher::finish() {
  Digest digest;
  crypto_generichash_final(reinterpret_cast<crypto_generichash_state*>(&state_), digest.bytes.data(),
                           digest.bytes.size());
  return digest;
}

Digest digestOf(std::span<const std::uint8_t> bytes) {
  Hasher hasher;
  hasher.raw(bytes.data(), bytes.size());
  return hasher.finish();
}

Digest digestOfFile(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw InputError(path.string(), "", "cannot be read");
  Hasher hasher;
  std::vector<char> part(std::size_t{1} << 20);
  while (in.read(part.data(), static_cast<std::streamsize>(part.size())) || in.gcount() > 0)
    hasher.raw(part.data(), static_cast<std::size_t>(in.gcount()));
  if (in.bad()) throw InputError(path.string(), "", "cannot be read to its end");
  return hasher.finish();
}

Digest digestOfFolder(const std::filesystem::path& folder, std::span<const std::string_view> except) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) names.push_back(entry.path().lexically_relative(folder).generic_string());
  std::sort(names.begin(), names.end());
  Hasher hasher;
  for (const std::string& name : names)
    if (std::find(except.begin(), except.end(), name) == except.end())
      hasher.add(name, digestOfFile(folder / name));
  return hasher.finish();
}

}  // namespace fathom::topside
