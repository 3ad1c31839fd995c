#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// The secret that ship and vehicle share: 32 bytes. Signs downlink frames with keyed BLAKE2b (RFC 7693, by
// libsodium), cut to kSignatureBytes. Forgers get one try a frame: 40 bits are one success in 1e12 tries,
// and a modem brings some ten a second. Wiped when it goes.
class DownlinkKey {
 public:
  static constexpr std::size_t kBytes = 32;
  static constexpr std::size_t kSignatureBytes = 5;
  using Signature = std::array<std::uint8_t, kSignatureBytes>;

  explicit DownlinkKey(std::span<const std::uint8_t, kBytes> secret);
  DownlinkKey(const DownlinkKey&) = default;
  DownlinkKey& operator=(const DownlinkKey&) = default;
  ~DownlinkKey();

  // Of `message` sent to this vehicle on this dive: another's frame does not verify.
  [[nodiscard]] Signature sign(const LinkIdentity& identity, std::span<const std::uint8_t> message) const;
  // Takes as long for a wrong signature as for a right one.
  [[nodiscard]] bool verify(const LinkIdentity& identity, std::span<const std::uint8_t> message,
                            std::span<const std::uint8_t> signature) const;

 private:
  std::array<std::uint8_t, kBytes> secret_{};
};

// A key file holds 64 hexadecimal digits and a line end. Throws InputError for anything else. `warning`
// becomes a sentence when others than the owner may use the file, else "".
[[nodiscard]] DownlinkKey readDownlinkKey(const std::filesystem::path& file, std::string& warning);

// Makes a new key: the file appears whole, for its owner alone (mode 0600). Throws InputError where a file
// exists already or none can be made.
void makeDownlinkKey(const std::filesystem::path& file);

}  // namespace fathom::telemetry
