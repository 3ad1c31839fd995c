#include "telemetry/wire/packet_log.hpp"

#include <array>
#include <iterator>

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/input_error.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::size_t kHeadBytes = 12;                      // u32 length, i64 time
constexpr std::int64_t kLatest_ns = std::int64_t{1} << 62;  // the year 2116

bool canBeTime(std::int64_t utc_ns) {
  return utc_ns >= -kLatest_ns && utc_ns <= kLatest_ns;
}

bool canHoldFrame(std::span<const std::uint8_t> modem_frame) {
  LinkFrames frames(modem_frame);
  while (const auto frame = frames.next())
    if (peekFrame(*frame).verdict == FrameVerdict::kAccepted) return true;
  return false;
}

}  // namespace

bool writePacket(std::ostream& stream, std::int64_t utc_ns, std::span<const std::uint8_t> frame) {
  std::array<std::uint8_t, kHeadBytes> head{};
  writeLittleEndian(std::span(head).first(4), frame.size());
  writeLittleEndian(std::span(head).subspan(4), static_cast<std::uint64_t>(utc_ns));
  stream.write(reinterpret_cast<const char*>(head.data()), kHeadBytes);
  stream.write(reinterpret_cast<const char*>(frame.data()), static_cast<std::streamsize>(frame.size()));
  return stream.good();
}

PacketLogReader::PacketLogReader(const std::filesystem::path& path)
    : path_(path), stream_(path, std::ios::binary) {
  if (!stream_ || std::filesystem::is_directory(path))
    throw InputError(path.string(), "", "cannot be read: give a packets.bin of an onboard folder");
}

std::optional<Packet> PacketLogReader::next() {
  const auto place = [&] { return "byte " + std::to_string(offset_); };
  std::array<std::uint8_t, kHeadBytes> head{};
  stream_.read(reinterpret_cast<char*>(head.data()), kHeadBytes);
  if (stream_.gcount() == 0) return std::nullopt;
  if (stream_.gcount() != static_cast<std::streamsize>(kHeadBytes))
    throw InputError(path_.string(), place(), "the last packet is cut short: copy the file again");
  const std::uint64_t length = littleEndianAt<std::uint32_t>(head, 0);
  if (length == 0 || length > kMaxModemBytes)
    throw InputError(path_.string(), place(),
                     "a packet of " + std::to_string(length) + " bytes, expected 1 to " +
                         std::to_string(kMaxModemBytes) + ": not a packets.bin, or damaged");
  Packet packet;
  packet.utc_ns = static_cast<std::int64_t>(littleEndianAt<std::uint64_t>(head, 4));
  if (!canBeTime(packet.utc_ns))
    throw InputError(path_.string(), place(), "a packet of no time: not a packets.bin, or damaged");
  packet.bytes.resize(length);
  stream_.read(reinterpret_cast<char*>(packet.bytes.data()), static_cast<std::streamsize>(length));
  if (stream_.gcount() != static_cast<std::streamsize>(length))
    throw InputError(path_.string(), place(), "the last packet is cut short: copy the file again");
  offset_ += kHeadBytes + length;
  return packet;
}

bool PacketLogReader::passOverDamage() {
  stream_.clear();
  stream_.seekg(static_cast<std::streamoff>(offset_));
  std::vector<std::uint8_t> rest((std::istreambuf_iterator<char>(stream_)), std::istreambuf_iterator<char>());
  stream_.clear();
  for (std::size_t at = 1; at + kHeadBytes < rest.size(); ++at) {
    const std::uint64_t length = littleEndianAt<std::uint32_t>(rest, at);
    if (length < kFrameOverhead || length > kMaxModemBytes || length > rest.size() - at - kHeadBytes)
      continue;
    if (!canBeTime(static_cast<std::int64_t>(littleEndianAt<std::uint64_t>(rest, at + 4)))) continue;
    // A frame can begin there, and another record or the file's end follows it.
    if (!canHoldFrame(std::span(rest).subspan(at + kHeadBytes, length))) continue;
    const std::size_t after = at + kHeadBytes + length;
    if (after != rest.size() &&
        (after + kHeadBytes > rest.size() || littleEndianAt<std::uint32_t>(rest, after) > kMaxModemBytes))
      continue;
    offset_ += at;
    stream_.seekg(static_cast<std::streamoff>(offset_));
    return true;
  }
  return false;
}

}  // namespace fathom::telemetry
