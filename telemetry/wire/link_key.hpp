#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace fathom::telemetry {

// Whose link it is.
struct LinkIdentity {
  std::uint8_t vehicle_id = 0;
  std::uint16_t dive_id = 0;
  friend bool operator==(const LinkIdentity&, const LinkIdentity&) = default;
};

// The secret that ship and vehicle share: 32 bytes. Frames of the vehicle are tagged with a key derived from
// it (FrameTag); downlink frames are signed with keyed BLAKE2b (RFC 7693, by libsodium), cut to
// kSignatureBytes. Forgers get one try a frame: 40 bits are one success in 1e12 tries, and a modem brings
// some ten a second. Wiped when it goes.
class LinkKey {
 public:
  static constexpr std::size_t kBytes = 32;
  static constexpr std::size_t kSignatureBytes = 5;
  using Signature = std::array<std::uint8_t, kSignatureBytes>;

  explicit LinkKey(std::span<const std::uint8_t, kBytes> secret);
  LinkKey(const LinkKey&) = default;
  LinkKey& operator=(const LinkKey&) = default;
  ~LinkKey();

  // Of `message` sent to this vehicle on this dive: another's frame does not verify.
  [[nodiscard]] Signature sign(const LinkIdentity& identity, std::span<const std::uint8_t> message) const;
  // Takes as long for a wrong signature as for a right one.
  [[nodiscard]] bool verify(const LinkIdentity& identity, std::span<const std::uint8_t> message,
                            std::span<const std::uint8_t> signature) const;
  // A key for one purpose, 16 to 64 bytes, from which neither this one nor another purpose's can be found.
  void derive(std::string_view purpose, std::span<std::uint8_t> key) const;

 private:
  std::array<std::uint8_t, kBytes> secret_{};
};

// A key file holds 64 hexadecimal digits and a line end. Throws InputError for anything else. `warning`
// becomes a sentence when others than the owner may use the file, else "".
[[nodiscard]] LinkKey readLinkKey(const std::filesystem::path& file, std::string& warning);

// Makes a new key: the file appears whole, for its owner alone (mode 0600). Throws InputError where a file
// exists already or none can be made.
void makeLinkKey(const std::filesystem::path& file);

}  // namespace fathom::telemetry
