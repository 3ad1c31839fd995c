#include "telemetry/wire/link_key.hpp"

#include <sodium.h>
#include <sys/stat.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string_view>

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/files/descriptor.hpp"
#include "realtime/base/input_error.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::size_t kDigits = 2 * LinkKey::kBytes;
constexpr const char* kFix =
    "must hold 64 hexadecimal digits and nothing else; make one with fathom-monitor key FILE";
// Keeps these signatures apart from any other use of the same key.
constexpr std::string_view kPurpose = "Fathom downlink 3";
// The shortest hash that libsodium gives.
constexpr std::size_t kHashBytes = crypto_generichash_BYTES_MIN;
static_assert(LinkKey::kSignatureBytes <= kHashBytes);
static_assert(LinkKey::kBytes >= crypto_generichash_KEYBYTES_MIN &&
              LinkKey::kBytes <= crypto_generichash_KEYBYTES_MAX);

void startSodium() {
  if (sodium_init() < 0) throw std::runtime_error("libsodium cannot start");
}

}  // namespace

LinkKey::LinkKey(std::span<const std::uint8_t, kBytes> secret) {
  startSodium();
  std::copy(secret.begin(), secret.end(), secret_.begin());
}

LinkKey::~LinkKey() {
  sodium_memzero(secret_.data(), secret_.size());
}

LinkKey::Signature LinkKey::sign(const LinkIdentity& identity, std::span<const std::uint8_t> message) const {
  const std::array<std::uint8_t, 3> address = {identity.vehicle_id,
                                               static_cast<std::uint8_t>(identity.dive_id >> 8),
                                               static_cast<std::uint8_t>(identity.dive_id)};
  std::array<std::uint8_t, kHashBytes> hash{};
  crypto_generichash_state state;
  crypto_generichash_init(&state, secret_.data(), secret_.size(), hash.size());
  crypto_generichash_update(&state, reinterpret_cast<const unsigned char*>(kPurpose.data()), kPurpose.size());
  crypto_generichash_update(&state, address.data(), address.size());
  crypto_generichash_update(&state, message.data(), message.size());
  crypto_generichash_final(&state, hash.data(), hash.size());
  Signature signature{};
  std::copy_n(hash.begin(), signature.size(), signature.begin());
  return signature;
}

bool LinkKey::verify(const LinkIdentity& identity, std::span<const std::uint8_t> message,
                     std::span<const std::uint8_t> signature) const {
  const Signature right = sign(identity, message);
  return signature.size() == right.size() && sodium_memcmp(right.data(), signature.data(), right.size()) == 0;
}

void LinkKey::derive(std::string_view purpose, std::span<std::uint8_t> key) const {
  (void)crypto_generichash(key.data(), key.size(), reinterpret_cast<const unsigned char*>(purpose.data()),
                           purpose.size(), secret_.data(), secret_.size());
}

LinkKey readLinkKey(const std::filesystem::path& file, std::string& warning) {
  startSodium();
  warning.clear();
  // Opened without waiting: a pipe would block the program.
  const Descriptor in(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat about {};
  if (in.get() < 0 || ::fstat(in.get(), &about) != 0)
    throw InputError(file.string(), "", std::string("cannot be read (") + std::strerror(errno) + ")");
  if (!S_ISREG(about.st_mode)) throw InputError(file.string(), "", "is no file");
  // Room for one byte more than the longest valid file, so that a longer one is noticed.
  std::array<char, kDigits + 3> text{};
  const ssize_t got = ::read(in.get(), text.data(), text.size());
  std::size_t size = got > 0 ? static_cast<std::size_t>(got) : 0;
  if (size > 0 && text[size - 1] == '\n') --size;
  if (size > 0 && text[size - 1] == '\r') --size;
  std::array<std::uint8_t, LinkKey::kBytes> secret{};
  std::size_t bytes = 0;
  const char* end = nullptr;
  const bool good =
      size == kDigits &&
      sodium_hex2bin(secret.data(), secret.size(), text.data(), size, nullptr, &bytes, &end) == 0 &&
      bytes == secret.size() && end == text.data() + size;
  sodium_memzero(text.data(), text.size());
  if (!good) throw InputError(file.string(), "", kFix);
  if ((about.st_mode & (S_IRWXG | S_IRWXO)) != 0)
    warning = file.string() + " holds a secret that others may read; take it from them with chmod 600";
  const LinkKey key(secret);
  sodium_memzero(secret.data(), secret.size());
  return key;
}

void makeLinkKey(const std::filesystem::path& file) {
  startSodium();
  std::array<std::uint8_t, LinkKey::kBytes> secret{};
  randombytes_buf(secret.data(), secret.size());
  std::array<char, kDigits + 1> text{};
  sodium_bin2hex(text.data(), text.size(), secret.data(), secret.size());
  text[kDigits] = '\n';
  sodium_memzero(secret.data(), secret.size());

  const std::string temporary = file.string() + ".tmp";
  const auto refuse = [&](int error) {
    sodium_memzero(text.data(), text.size());
    throw InputError(file.string(), "",
                     error == EEXIST ? "exists already; a key is never overwritten: give another name"
                                     : std::string("cannot be written (") + std::strerror(error) + ")");
  };
  const Descriptor out(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, S_IRUSR | S_IWUSR));
  if (out.get() < 0) refuse(errno);
  // A hard link, unlike a rename, fails where the name is taken.
  const bool written = ::write(out.get(), text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
                       ::fsync(out.get()) == 0 && ::link(temporary.c_str(), file.c_str()) == 0;
  const int error = errno;
  ::unlink(temporary.c_str());
  if (!written) refuse(error);
  sodium_memzero(text.data(), text.size());
}

FrameTag::FrameTag(const std::optional<LinkKey>& key) : keyed_(key.has_value()) {
  static_assert(std::tuple_size_v<decltype(secret_)> == crypto_shorthash_KEYBYTES);
  if (key) key->derive("Fathom uplink 4", secret_);
}

std::uint32_t FrameTag::of(std::span<const std::uint8_t> bytes, std::uint16_t lap) const {
  assert(bytes.size() <= kMaxFrameBytes);
  std::array<std::uint8_t, kMaxFrameBytes + 2> text;
  std::copy(bytes.begin(), bytes.end(), text.begin());
  std::size_t size = bytes.size();
  if (keyed_) {
    writeBigEndian(std::span(text).subspan(size, sizeof lap), lap);
    size += sizeof lap;
  }
  std::array<std::uint8_t, crypto_shorthash_BYTES> hash;
  crypto_shorthash(hash.data(), text.data(), size, secret_.data());
  return bigEndianAt<std::uint32_t>(hash, 0);
}

}  // namespace fathom::telemetry
