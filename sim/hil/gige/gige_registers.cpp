#include "sim/hil/gige/gige_registers.hpp"

#include <bit>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "firmware_if/devices/camera/pixel_unpack.hpp"
#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/text.hpp"

namespace fathom::sim {
namespace {

using Entries = std::vector<std::pair<std::string, std::uint32_t>>;

constexpr std::uint32_t kTicksPerSecond = 125'000'000;  // 8 ns, as cameras with IEEE 1588 count
constexpr std::size_t kNameBytes = 32, kInformationBytes = 48, kSerialBytes = 16, kUrlBytes = 512;

std::string hex(std::uint32_t value) {
  return formatted("0x%x", value);
}

std::string tag(const char* name, const std::string& value) {
  return std::string("<") + name + ">" + value + "</" + name + ">";
}

// Nodes of a GenICam description (GenICam Standard 2.0, section 2).
class Description {
 public:
  void text(const std::string& name, std::uint32_t address, std::size_t bytes) {
    feature(name);
    nodes_ += "<StringReg Name=\"" + name + "\">" + place(address, bytes, "RO") + "</StringReg>\n";
  }
  void integer(const std::string& name, std::uint32_t address, const char* access, const std::string& least,
               const std::string& most) {
    feature(name);
    nodes_ += "<Integer Name=\"" + name + "\"><pValue>" + name + "Register</pValue>" + least + most +
              "<Inc>1</Inc></Integer>\n" + reg(name, address, access);
  }
  void number(const std::string& name, std::uint32_t address, double least, double most) {
    feature(name);
    nodes_ += "<Float Name=\"" + name + "\"><pValue>" + name + "Register</pValue>" +
              tag("Min", std::to_string(least)) + tag("Max", std::to_string(most)) + "</Float>\n" +
              "<FloatReg Name=\"" + name + "Register\">" + place(address, 4, "RW") +
              "<Endianess>BigEndian</Endianess></FloatReg>\n";
  }
  void choice(const std::string& name, std::uint32_t address, const Entries& entries) {
    feature(name);
    nodes_ += "<Enumeration Name=\"" + name + "\">";
    for (const auto& [entry, value] : entries)
      nodes_ += "<EnumEntry Name=\"" + entry + "\">" + tag("Value", std::to_string(value)) + "</EnumEntry>";
    nodes_ += "<pValue>" + name + "Register</pValue></Enumeration>\n" + reg(name, address, "RW");
  }
  void flag(const std::string& name, std::uint32_t address) {
    feature(name);
    nodes_ += "<Boolean Name=\"" + name + "\"><pValue>" + name +
              "Register</pValue><OnValue>1</OnValue><OffValue>0</OffValue></Boolean>\n" +
              reg(name, address, "RW");
  }
  void command(const std::string& name, std::uint32_t address, std::uint32_t value) {
    feature(name);
    nodes_ += "<Command Name=\"" + name + "\"><pValue>" + name + "Register</pValue>" +
              tag("CommandValue", std::to_string(value)) + "</Command>\n" + reg(name, address, "WO");
  }
  // One bit of a register, counted from its highest as the standard does.
  void bit(const std::string& name, std::uint32_t address, int number, bool is_command) {
    feature(name);
    nodes_ += is_command ? "<Command Name=\"" + name + "\"><pValue>" + name + "Register</pValue>" +
                               tag("CommandValue", "1") + "</Command>\n"
                         : "<Boolean Name=\"" + name + "\"><pValue>" + name + "Register</pValue></Boolean>\n";
    nodes_ += "<MaskedIntReg Name=\"" + name + "Register\">" + place(address, 4, "RW") +
              tag("Bit", std::to_string(number)) +
              "<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></MaskedIntReg>\n";
  }
  void formula(const std::string& name, const std::vector<std::string>& variables,
               const std::string& formula) {
    feature(name);
    nodes_ += "<IntSwissKnife Name=\"" + name + "\">";
    for (const std::string& v : variables) nodes_ += "<pVariable Name=\"" + v + "\">" + v + "</pVariable>";
    nodes_ += tag("Formula", formula) + "</IntSwissKnife>\n";
  }
  [[nodiscard]] std::string finish() const {
    return "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"
           "<RegisterDescription ModelName=\"GigE\" VendorName=\"Fathom\" StandardNameSpace=\"GEV\" "
           "SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" "
           "MinorVersion=\"0\" SubMinorVersion=\"0\" ToolTip=\"Simulated camera\" "
           "ProductGuid=\"0\" VersionGuid=\"0\" xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">\n"
           "<Category Name=\"Root\" NameSpace=\"Standard\">" +
           features_ + "</Category>\n" + nodes_ + "<Port Name=\"Device\" NameSpace=\"Standard\"></Port>\n" +
           "</RegisterDescription>\n";
  }

 private:
  void feature(const std::string& name) { features_ += tag("pFeature", name); }
  static std::string place(std::uint32_t address, std::size_t bytes, const char* access) {
    return tag("Address", hex(address)) + tag("Length", std::to_string(bytes)) + tag("AccessMode", access) +
           tag("pPort", "Device");
  }
  static std::string reg(const std::string& name, std::uint32_t address, const char* access) {
    return "<IntReg Name=\"" + name + "Register\">" + place(address, 4, access) +
           "<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>\n";
  }
  std::string features_, nodes_;
};

std::string genicamDescription(bool bayer, int bits) {
  using namespace gige;
  Description d;
  d.text("DeviceVendorName", kVendor, kNameBytes);
  d.text("DeviceModelName", kModel, kNameBytes);
  d.text("DeviceVersion", kDeviceVersion, kNameBytes);
  d.text("DeviceID", kSerial, kSerialBytes);
  d.text("DeviceSerialNumber", kSerial, kSerialBytes);
  const auto min = [](const char* value) { return tag("Min", value); };
  const auto at_most = [](const char* feature) { return tag("pMax", feature); };
  d.integer("SensorWidth", kSensorWidth, "RO", min("1"), tag("Max", "65535"));
  d.integer("SensorHeight", kSensorHeight, "RO", min("1"), tag("Max", "65535"));
  d.integer("Width", kWidth, "RW", min("1"), at_most("SensorWidth"));
  d.integer("Height", kHeight, "RW", min("1"), at_most("SensorHeight"));
  d.integer("OffsetX", kOffsetX, "RW", min("0"), at_most("SensorWidth"));
  d.integer("OffsetY", kOffsetY, "RW", min("0"), at_most("SensorHeight"));
  Entries formats;
  for (const io::WireFormat& wire : io::wireFormats())
    if ((wire.format == PixelFormat::kBayerRggb) == bayer && wire.bits <= bits)
      formats.emplace_back(wire.name, wire.code);
  d.choice("PixelFormat", kPixelFormat, formats);
  // Bits a pixel stand in the format's code.
  d.formula("PayloadSize", {"Width", "Height", "PixelFormat"},
            "(Width * Height * ((PixelFormat &gt;&gt; 16) &amp; 255) + 7) / 8");
  d.choice("AcquisitionMode", kAcquisitionMode, {{"Continuous", 1}});
  d.command("AcquisitionStart", kAcquisition, 1);
  d.command("AcquisitionStop", kAcquisition, 0);
  d.number("AcquisitionFrameRate", kFrameRate, 0.1, 1000);
  d.number("ExposureTime", kExposure, 1, 10'000'000);
  d.number("Gain", kGain, 0, 48);
  d.choice("TriggerSelector", kTriggerMode + 0x0c, {{"FrameStart", 0}});
  d.choice("TriggerMode", kTriggerMode, {{"Off", 0}, {"On", 1}});
  d.choice("TriggerSource", kTriggerSource, {{"Line1", 0}, {"Line2", 1}});
  d.choice("TriggerActivation", kTriggerActivation, {{"RisingEdge", 0}, {"FallingEdge", 1}});
  d.flag("PtpEnable", kPtpEnable);
  d.bit("GevSCPSFireTestPacket", kPacketSize, 0, true);
  d.bit("GevSCPSDoNotFragment", kPacketSize, 1, false);
  return d.finish();
}

bool writable(std::uint32_t address) {
  using namespace gige;
  switch (address) {
    case kHeartbeatTimeout:
    case kStampControl:
    case kControlPrivilege:
    case kStreamPort:
    case kPacketSize:
    case kPacketDelay:
    case kStreamAddress:
      return true;
    default:
      return address >= kWidth && address < kMemoryBytes;
  }
}

}  // namespace

GigeRegisters::GigeRegisters(std::uint32_t address, std::uint32_t netmask, const std::string& serial,
                             int width, int height, bool bayer, int bits)
    : xml_(genicamDescription(bayer, bits)) {
  using namespace gige;
  set(kVersion, 0x00010002);
  set(kDeviceMode, 0x80000001);  // big-endian, UTF-8
  // A locally administered MAC address, from the IP address.
  set(kMacHigh, 0x00000200);
  set(kMacLow, address);
  set(kIpConfigurations, 5);
  set(kIpConfiguration, 5);
  set(kCurrentIp, address);
  set(kSubnetMask, netmask);
  setText(kVendor, kNameBytes, "Fathom");
  setText(kModel, kNameBytes, "Simulated");
  setText(kDeviceVersion, kNameBytes, "1");
  setText(kInformation, kInformationBytes, "plays a mission's images");
  setText(kSerial, kSerialBytes, serial);
  setText(kXmlUrl, kUrlBytes,
          "Local:fathom.xml;" + hex(kXmlAddress).substr(2) + ";" +
              hex(static_cast<std::uint32_t>(xml_.size())).substr(2));
  set(kInterfaces, 1);
  set(kStreamChannels, 1);
  set(kCapability, 7);  // concatenation, write memory, packet resend
  set(kHeartbeatTimeout, 3000);
  set(kTickFrequencyLow, kTicksPerSecond);
  set(kPacketSize, 1400);
  set(kSensorWidth, static_cast<std::uint32_t>(width));
  set(kSensorHeight, static_cast<std::uint32_t>(height));
  set(kWidth, static_cast<std::uint32_t>(width));
  set(kHeight, static_cast<std::uint32_t>(height));
  set(kPixelFormat, io::wireFormat(bayer ? "BayerRG8" : "Mono8")->code);
  set(kAcquisitionMode, 1);
  setFloat(kFrameRate, 2);
  setFloat(kExposure, 4000);
}

std::uint32_t GigeRegisters::get(std::uint32_t address) const {
  std::array<std::uint8_t, 4> b{};
  if (!read(address, b)) return 0;
  return bigEndianAt<std::uint32_t>(b, 0);
}

float GigeRegisters::getFloat(std::uint32_t address) const {
  return std::bit_cast<float>(get(address));
}

void GigeRegisters::set(std::uint32_t address, std::uint32_t value) {
  for (int i = 0; i < 4; ++i)
    memory_.at(address + static_cast<std::uint32_t>(i)) = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

void GigeRegisters::setFloat(std::uint32_t address, float value) {
  set(address, std::bit_cast<std::uint32_t>(value));
}

void GigeRegisters::setText(std::uint32_t address, std::size_t size, std::string_view text) {
  if (text.size() >= size) throw std::invalid_argument("longer than its register: " + std::string(text));
  std::memcpy(&memory_.at(address), text.data(), text.size());
}

bool GigeRegisters::read(std::uint32_t address, std::span<std::uint8_t> out) const {
  const std::span<const std::uint8_t> xml(reinterpret_cast<const std::uint8_t*>(xml_.data()), xml_.size());
  const bool is_xml = address >= gige::kXmlAddress;
  const std::span<const std::uint8_t> from = is_xml ? xml : std::span<const std::uint8_t>(memory_);
  const std::size_t at = is_xml ? address - gige::kXmlAddress : address;
  if (at >= from.size()) return false;
  // A client reads the description in whole words; it is padded with zeros.
  const std::size_t available = std::min(out.size(), from.size() - at);
  if (available < out.size() && !is_xml) return false;
  std::memcpy(out.data(), from.data() + at, available);
  std::memset(out.data() + available, 0, out.size() - available);
  return true;
}

bool GigeRegisters::write(std::uint32_t address, std::span<const std::uint8_t> bytes) {
  if (bytes.empty() || bytes.size() % 4 != 0 || address % 4 != 0) return false;
  for (std::size_t i = 0; i < bytes.size(); i += 4)
    if (!writable(address + static_cast<std::uint32_t>(i)) || address + i + 4 > memory_.size()) return false;
  std::memcpy(&memory_[address], bytes.data(), bytes.size());
  return true;
}

}  // namespace fathom::sim
