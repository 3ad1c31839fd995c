#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "realtime/kernel/time/clock.hpp"
#include "sim/hil/gige/gige_packets.hpp"
#include "sim/hil/gige/gige_registers.hpp"

namespace fathom::sim {

// Network interface and clock of a simulated camera: registers, the control protocol (discovery, heartbeat,
// time stamp latch, test packet), and sending and resending of frames as packets.
class GigeDevice {
 public:
  struct Config {
    std::string interface = "127.0.0.1";  // address to serve on
    std::string serial;
    int width = 0, height = 0;
    bool bayer = false;
    int bits = 12;
    double clock_ppm = 0;  // rate error of its clock, positive: fast
  };

  // Throws InputError for an address that cannot be served.
  explicit GigeDevice(Config config);

  // Starts with the clock at `shows_ns` and factory settings in the registers.
  void powerOn(std::int64_t shows_ns);
  void powerOff();
  [[nodiscard]] bool on() const { return registers_.has_value(); }

  // Answers clients until then [monotonic], 100 ms or the first request.
  void serveUntil(std::int64_t mono_ns);
  // Whether a client wants frames. False without power.
  [[nodiscard]] bool streaming() const;
  // Reading of the clock at a monotonic time; with IEEE 1588 on, TAI.
  [[nodiscard]] std::int64_t clockNs(std::int64_t mono_ns) const;
  [[nodiscard]] std::int64_t exposureNs() const;  // by its register
  [[nodiscard]] const GigeRegisters& registers() const { return *registers_; }
  // Image bytes in a data packet, by its register.
  [[nodiscard]] std::size_t dataBytes() const;
  [[nodiscard]] static std::uint64_t ticksOf(std::int64_t clock_ns);

  // Sends a frame without the packets `lost`; those of `never` are not resent either.
  void send(GvspFrame frame, const std::set<std::uint32_t>& lost, std::set<std::uint32_t> never);

 private:
  struct Client {
    std::uint32_t address = 0;
    std::uint16_t port = 0;
    bool operator==(const Client&) const = default;
  };
  struct Sent {
    GvspFrame frame;
    std::set<std::uint32_t> never;
  };
  void listen();
  void take(const GigeSocket& socket);
  void answer(const GvcpRequest& request, const sockaddr_in& from);
  GvcpStatus readRegisters(std::span<const std::uint8_t> in, std::vector<std::uint8_t>& out) const;
  GvcpStatus writeRegisters(std::span<const std::uint8_t> in, const Client& client,
                            std::vector<std::uint8_t>& out);
  GvcpStatus readMemory(std::span<const std::uint8_t> in, std::vector<std::uint8_t>& out) const;
  GvcpStatus writeMemory(std::span<const std::uint8_t> in, const Client& client,
                         std::vector<std::uint8_t>& out);
  void afterWrite(std::uint32_t address, const Client& client);
  void resend(std::span<const std::uint8_t> in);
  void sendPacket(const std::vector<std::uint8_t>& bytes);
  void releaseSilentClient();

  Config config_;
  rt::RealClock clock_;
  OwnNetwork network_;
  std::int64_t utc_ahead_ns_;                  // of the monotonic clock, at the construction
  std::int64_t zero_mono_ns_ = 0, shown_ = 0;  // reading of the clock at this monotonic time
  std::optional<GigeRegisters> registers_;     // none without power
  std::vector<GigeSocket> control_;            // own address first
  GigeSocket stream_;
  std::optional<Client> controller_;
  std::int64_t heartbeat_mono_ns_ = 0;
  std::vector<Sent> sent_;  // the newest last
};

}  // namespace fathom::sim
