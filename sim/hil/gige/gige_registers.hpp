#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace fathom::sim {

// Addresses of a simulated camera's registers, 32 bits each unless said. Below 0x1000 the bootstrap registers
// of GigE Vision (version 1.2, section 27), above what its GenICam description names.
namespace gige {
inline constexpr std::uint32_t kVersion = 0x0000, kDeviceMode = 0x0004, kMacHigh = 0x0008, kMacLow = 0x000c,
                               kIpConfigurations = 0x0010, kIpConfiguration = 0x0014, kCurrentIp = 0x0024,
                               kSubnetMask = 0x0034, kGateway = 0x0044, kVendor = 0x0048, kModel = 0x0068,
                               kDeviceVersion = 0x0088, kInformation = 0x00a8, kSerial = 0x00d8,
                               kUserName = 0x00e8, kDiscoveryBytes = 0x00f8, kXmlUrl = 0x0200,
                               kInterfaces = 0x0600, kStreamChannels = 0x0904, kCapability = 0x0934,
                               kHeartbeatTimeout = 0x0938, kTickFrequencyHigh = 0x093c,
                               kTickFrequencyLow = 0x0940, kStampControl = 0x0944, kStampHigh = 0x0948,
                               kStampLow = 0x094c, kControlPrivilege = 0x0a00, kStreamPort = 0x0d00,
                               kPacketSize = 0x0d04, kPacketDelay = 0x0d08, kStreamAddress = 0x0d18;
inline constexpr std::uint32_t kSensorWidth = 0x2000, kSensorHeight = 0x2004, kWidth = 0x2008,
                               kHeight = 0x200c, kOffsetX = 0x2010, kOffsetY = 0x2014, kPixelFormat = 0x2018,
                               kAcquisitionMode = 0x2020, kAcquisition = 0x2024, kFrameRate = 0x2028,
                               kExposure = 0x202c, kGain = 0x2030, kTriggerMode = 0x2040,
                               kTriggerSource = 0x2044, kTriggerActivation = 0x2048, kPtpEnable = 0x2050;
inline constexpr std::uint32_t kMemoryBytes = 0x3000, kXmlAddress = 0x10000;
}  // namespace gige

// Register memory of a simulated camera with its GenICam description. Big-endian, as on the wire. Reads and
// writes outside of it fail.
class GigeRegisters {
 public:
  // `address`: own IP; `bits`: of the pixels it can give, 8 or 12.
  GigeRegisters(std::uint32_t address, std::uint32_t netmask, const std::string& serial, int width,
                int height, bool bayer, int bits);

  [[nodiscard]] std::uint32_t get(std::uint32_t address) const;  // 0 outside
  [[nodiscard]] float getFloat(std::uint32_t address) const;
  void set(std::uint32_t address, std::uint32_t value);
  [[nodiscard]] bool read(std::uint32_t address, std::span<std::uint8_t> out) const;
  // False for registers that a client may not write.
  [[nodiscard]] bool write(std::uint32_t address, std::span<const std::uint8_t> bytes);

 private:
  void setFloat(std::uint32_t address, float value);
  void setText(std::uint32_t address, std::size_t size, std::string_view text);
  std::array<std::uint8_t, gige::kMemoryBytes> memory_{};
  std::string xml_;
};

}  // namespace fathom::sim
