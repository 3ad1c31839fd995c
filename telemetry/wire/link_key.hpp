#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace fathom::telemetry {

// The vehicle and dive that a frame belongs to.
struct LinkIdentity {
  std::uint8_t vehicle_id = 0;
  std::uint16_t dive_id = 0;
  friend bool operator==(const LinkIdentity&, const LinkIdentity&) = default;
};

// The secret that ship and vehicle share: 32 bytes. Frames of the vehicle are tagged with a key derived from
// it (FrameTag); downlink frames are signed with keyed BLAKE2b (RFC 7693, by libsodium), cut to
// kSignatureBytes. A forger has one try a frame: 40 bits are one success in 1e12 tries, and a modem brings
// some ten frames a second. The destructor wipes the secret.
class LinkKey {
 public:
  static constexpr std::size_t kBytes = 32;
  static constexpr std::size_t kSignatureBytes = 5;
  using Signature = std::array<std::uint8_t, kSignatureBytes>;

  explicit LinkKey(std::span<const std::uint8_t, kBytes> secret);
  LinkKey(const LinkKey&) = default;
  LinkKey& operator=(const LinkKey&) = default;
  ~LinkKey();

  // Signature of `message` to this vehicle on this dive; it does not verify for another.
  [[nodiscard]] Signature sign(const LinkIdentity& identity, std::span<const std::uint8_t> message) const;
  // Takes as long for a wrong signature as for a right one.
  [[nodiscard]] bool verify(const LinkIdentity& identity, std::span<const std::uint8_t> message,
                            std::span<const std::uint8_t> signature) const;
  // Derives a key for one purpose, 16 to 64 bytes, from which neither this key nor that of another purpose
  // can be computed.
  void derive(std::string_view purpose, std::span<std::uint8_t> key) const;

 private:
  std::array<std::uint8_t, kBytes> secret_{};
};

// Reads a key file: 64 hexadecimal digits and a line end. Throws InputError for anything else. `warning`
// becomes a sentence when others than the owner may read or write the file, else "".
[[nodiscard]] LinkKey readLinkKey(const std::filesystem::path& file, std::string& warning);

// Writes a new random key: the file appears whole, for its owner alone (mode 0600). Throws InputError when
// the file exists or cannot be written.
void makeLinkKey(const std::filesystem::path& file);

// The 32 bits that end a frame: SipHash-2-4 (Aumasson & Bernstein 2012, by libsodium) of the bytes before
// them, cut to four bytes. With the key that ship and vehicle share they authenticate the sender, the content
// and, through the lap, the time in the dive: one forged frame in 2^32 passes. Without a key they are a
// checksum as good as CRC-32, and the lap does not count.
class FrameTag {
 public:
  FrameTag() = default;
  explicit FrameTag(const std::optional<LinkKey>& key);

  [[nodiscard]] bool keyed() const { return keyed_; }
  // Tag of at most kMaxFrameBytes bytes. `lap`: the bits of the frame's version that the frame leaves out.
  [[nodiscard]] std::uint32_t of(std::span<const std::uint8_t> bytes, std::uint16_t lap) const;

 private:
  std::array<std::uint8_t, 16> secret_{};  // derived from the key, for this purpose alone
  bool keyed_ = false;
};

}  // namespace fathom::telemetry
