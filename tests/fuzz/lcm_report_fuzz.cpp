// Any bytes with a right CRC: the lengths in a report must not lead the generated decoder astray.
#include <cstdlib>
#include <vector>

#include "firmware_if/lcm_bus/health_report.hpp"
#include "firmware_if/log/checked_message.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace fathom::io;
  std::vector<std::uint8_t> message(data, data + size);
  // The fingerprint of one of the types, so that what follows is looked at.
  HealthReport health;
  health.stages.add({"stage", 1, 0, 1, 1, 1, 1});
  const std::vector<LogMessage> types = {encodeHealth(health), encodeMap({}), encodeLink({}), encodePose({})};
  if (message.size() < 13) return 0;
  const LogMessage& type = types[message[8] % types.size()];
  std::copy(type.data.begin(), type.data.begin() + 8, message.begin());
  const std::uint32_t crc = crcOf({message.data(), message.size() - kCheckBytes});
  for (std::size_t i = 0; i < kCheckBytes; ++i)
    message[message.size() - kCheckBytes + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
  if (const auto found = decodeHealth(message)) (void)encodeHealth(*found);
  if (const auto found = decodeMap(message)) (void)encodeMap(*found);
  if (const auto found = decodeLink(message)) (void)encodeLink(*found);
  if (const auto found = decodePose(message)) (void)encodePose(*found);
  return 0;
}
