#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <span>
#include <vector>

namespace fathom::telemetry {

// packets.bin: every modem frame that was sent or received, in order. For each:
//   u32 length [B], 1 to 2048; i64 UTC [ns]; the bytes. Little-endian, no header, so that files join by
//   concatenation.
struct Packet {
  std::int64_t utc_ns = 0;
  std::vector<std::uint8_t> bytes;
};

// Appends packets to a stream that the caller opened (an AtomicFile's, for instance); false when the stream
// fails.
[[nodiscard]] bool writePacket(std::ostream& stream, std::int64_t utc_ns,
                               std::span<const std::uint8_t> frame);

class PacketLogReader {
 public:
  explicit PacketLogReader(const std::filesystem::path& path);  // throws InputError if it cannot be read
  // The next packet; nullopt at the end. Throws InputError (file, byte, fix) for a length out of bounds or a
  // truncated packet.
  std::optional<Packet> next();
  // After next() has thrown: continues at the next packet of the file that holds a whole frame; false: there
  // is none.
  [[nodiscard]] bool passOverDamage();
  [[nodiscard]] std::uint64_t offset() const { return offset_; }  // of the next packet [B]

 private:
  std::filesystem::path path_;
  std::ifstream stream_;
  std::uint64_t offset_ = 0;
};

}  // namespace fathom::telemetry
