#include "firmware_if/devices/camera/camera_setup.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <utility>

#include "firmware_if/devices/camera/camera_discovery.hpp"

namespace fathom::io {
namespace {

constexpr std::uint16_t kControlPort = 3956;  // GVCP

// Bootstrap registers that every GigE Vision camera has (GigE Vision 2.0, section 28).
constexpr std::uint64_t kHeartbeatTimeout = 0x0938;  // [ms]
// After so long without a message of its controller a camera is free for another, so that a program that was
// killed and started again need not wait long. Aravis sends one every second.
constexpr std::uint32_t kHeartbeatMs = 2500;

// The address of the interface that packets to `address` leave by; empty when there is no route.
std::string ownAddressTowards(const std::string& address) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(kControlPort);
  if (::inet_pton(AF_INET, address.c_str(), &to.sin_addr) != 1) return "";
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket < 0) return "";
  sockaddr_in own{};
  socklen_t size = sizeof own;
  char name[INET_ADDRSTRLEN] = "";
  if (::connect(socket, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 &&
      ::getsockname(socket, reinterpret_cast<sockaddr*>(&own), &size) == 0)
    ::inet_ntop(AF_INET, &own.sin_addr, name, sizeof name);
  ::close(socket);
  return name;
}

// Reads the camera's description too, with a parser of Aravis that knows nothing of threads.
GObjectPtr<ArvCamera> openByAddress(GInetAddress* here, GInetAddress* there, AravisError& error) {
  static std::mutex one_at_a_time;
  const std::lock_guard lock(one_at_a_time);
  const GObjectPtr<ArvDevice> device(arv_gv_device_new(here, there, error.out()));
  if (error.failed() || device == nullptr) return nullptr;
  GObjectPtr<ArvCamera> camera(arv_camera_new_with_device(device.get(), error.out()));
  return error.failed() ? nullptr : std::move(camera);
}

// Runs settings until the first that fails; says which.
class CameraSettings {
 public:
  CameraSettings(ArvCamera* camera, std::string& why) : camera_(camera), why_(why) {}

  template <typename F>
  void need(const char* what, F&& set) {
    if (!good_) return;
    AravisError error;
    set(error.out());
    if (!error.failed()) return;
    good_ = false;
    why_ = std::string("refuses its ") + what + ": " + error.text();
  }
  // A setting that not every camera has, and that the pictures do not depend on.
  template <typename F>
  void wish(F&& set) {
    if (!good_) return;
    AravisError error;
    set(error.out());
    // Each further try would take as long again.
    if (error.timedOut()) fail("no longer answers");
  }
  [[nodiscard]] bool has(const char* feature) const {
    AravisError error;
    return arv_camera_is_feature_available(camera_, feature, error.out()) && !error.failed();
  }
  void fail(std::string why) {
    if (!good_) return;
    good_ = false;
    why_ = std::move(why);
  }
  [[nodiscard]] bool good() const { return good_; }

 private:
  ArvCamera* camera_;
  std::string& why_;
  bool good_ = true;
};

void setPicture(ArvCamera* camera, const CameraConfig& config, CameraSettings& setup) {
  setup.wish([&](GError** e) { arv_camera_stop_acquisition(camera, e); });
  setup.wish([&](GError** e) {
    if (arv_camera_is_binning_available(camera, e)) arv_camera_set_binning(camera, 1, 1, e);
  });
  setup.need("image size",
             [&](GError** e) { arv_camera_set_region(camera, 0, 0, config.width, config.height, e); });
  setup.need("pixel format", [&](GError** e) {
    arv_camera_set_pixel_format(camera, static_cast<ArvPixelFormat>(config.format.code), e);
  });
  setup.need("acquisition mode", [&](GError** e) {
    arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, e);
  });
  if (config.exposure_us > 0) {
    setup.wish([&](GError** e) { arv_camera_set_exposure_time_auto(camera, ARV_AUTO_OFF, e); });
    setup.need("exposure", [&](GError** e) { arv_camera_set_exposure_time(camera, config.exposure_us, e); });
  }
  if (config.gain_db >= 0) {
    setup.wish([&](GError** e) { arv_camera_set_gain_auto(camera, ARV_AUTO_OFF, e); });
    setup.need("gain", [&](GError** e) { arv_camera_set_gain(camera, config.gain_db, e); });
  }
}

void setTrigger(ArvCamera* camera, const CameraConfig& config, CameraSettings& setup) {
  setup.wish([&](GError** e) { arv_camera_clear_triggers(camera, e); });
  if (config.trigger == CameraTrigger::kLine) {
    // Selects FrameStart where there is one, rising edge, source, mode on.
    setup.need("trigger line",
               [&](GError** e) { arv_camera_set_trigger(camera, config.trigger_line.c_str(), e); });
    setup.need("trigger activation", [&](GError** e) {
      arv_camera_set_string(camera, "TriggerActivation", config.trigger_activation.c_str(), e);
    });
    return;
  }
  if (config.trigger == CameraTrigger::kPtp) {
    // Three generations of names for the same switch.
    if (setup.has("PtpEnable"))
      setup.need("PTP", [&](GError** e) { arv_camera_set_boolean(camera, "PtpEnable", TRUE, e); });
    else if (setup.has("GevIEEE1588"))
      setup.need("PTP", [&](GError** e) { arv_camera_set_boolean(camera, "GevIEEE1588", TRUE, e); });
    else if (setup.has("PtpMode"))
      setup.need("PTP", [&](GError** e) { arv_camera_set_string(camera, "PtpMode", "Slave", e); });
    else
      setup.fail("has no PTP; set cameras.trigger to free-run or line");
  }
  setup.need("frame rate", [&](GError** e) { arv_camera_set_frame_rate(camera, config.rate_hz, e); });
}

void setTransport(ArvCamera* camera, const CameraConfig& config, const std::string& address,
                  CameraSettings& setup) {
  ArvDevice* device = arv_camera_get_device(camera);
  setup.wish([&](GError** e) { arv_device_write_register(device, kHeartbeatTimeout, kHeartbeatMs, e); });
  // No packet socket receives on the loopback interface.
  const bool loopback = address.rfind("127.", 0) == 0;
  if (!config.packet_socket || loopback)
    arv_camera_gv_set_stream_options(camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  // Aravis would search again when a stream is created; once, here, is enough.
  arv_camera_gv_set_packet_size_adjustment(camera, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
  if (config.packet_size > 0) {
    setup.need("packet size",
               [&](GError** e) { arv_camera_gv_set_packet_size(camera, config.packet_size, e); });
  } else {
    setup.wish([&](GError** e) { arv_camera_gv_auto_packet_size(camera, e); });
  }
  if (config.packet_delay_ns > 0)
    setup.need("packet delay",
               [&](GError** e) { arv_camera_gv_set_packet_delay(camera, config.packet_delay_ns, e); });
}

void readBack(ArvCamera* camera, const CameraConfig& config, CameraIdentity& identity,
              CameraSettings& setup) {
  const std::size_t pixels = static_cast<std::size_t>(config.width) * static_cast<std::size_t>(config.height);
  setup.need("payload size", [&](GError** e) { identity.payload_bytes = arv_camera_get_payload(camera, e); });
  // A frame may end in chunks; it is never shorter than its pixels, nor absurdly longer.
  const std::size_t least = wireBytes(config.format.packing, pixels);
  constexpr std::size_t kMostBeside = 1 << 20;
  if (setup.good() && (identity.payload_bytes < least || identity.payload_bytes > least + kMostBeside))
    setup.fail("says that a frame has " + std::to_string(identity.payload_bytes) + " bytes where " +
               std::to_string(config.width) + " x " + std::to_string(config.height) + " pixels take " +
               std::to_string(least));
  int x = 0, y = 0, width = 0, height = 0;
  setup.need("image size", [&](GError** e) { arv_camera_get_region(camera, &x, &y, &width, &height, e); });
  if (setup.good() && (width != config.width || height != config.height))
    setup.fail("gives " + std::to_string(width) + " x " + std::to_string(height) + " pixels where " +
               std::to_string(config.width) + " x " + std::to_string(config.height) + " are asked");
  setup.wish(
      [&](GError** e) { identity.packet_size = static_cast<int>(arv_camera_gv_get_packet_size(camera, e)); });
  identity.exposure_s = identity.gain_db = 0;
  setup.wish([&](GError** e) { identity.exposure_s = arv_camera_get_exposure_time(camera, e) * 1e-6; });
  setup.wish([&](GError** e) { identity.gain_db = arv_camera_get_gain(camera, e); });
  if (!std::isfinite(identity.exposure_s)) identity.exposure_s = 0;
  if (!std::isfinite(identity.gain_db)) identity.gain_db = 0;
}

}  // namespace

GObjectPtr<ArvCamera> openCamera(const CameraConfig& config, CameraIdentity& identity, std::string& why) {
  identity.address = config.id;
  if (!isIpAddress(config.id)) {
    const std::vector<FoundCamera> found = findCameras(config.interface);
    const auto camera = std::find_if(found.begin(), found.end(),
                                     [&](const FoundCamera& c) { return isCamera(c, config.id); });
    if (camera == found.end()) {
      why = "does not answer on " + (config.interface.empty() ? "any interface" : config.interface) + " (" +
            std::to_string(found.size()) + " other cameras do)";
      return nullptr;
    }
    identity.address = camera->address;
  }
  AravisError error;
  // By its address: Aravis' own list of cameras is one for all threads.
  const GObjectPtr<GInetAddress> there(g_inet_address_new_from_string(identity.address.c_str()));
  const GObjectPtr<GInetAddress> here(
      g_inet_address_new_from_string(ownAddressTowards(identity.address).c_str()));
  if (there == nullptr || here == nullptr) {
    why = "has the address " + identity.address + ", to which there is no route";
    return nullptr;
  }
  GObjectPtr<ArvCamera> camera = openByAddress(here.get(), there.get(), error);
  if (camera == nullptr) {
    why = "cannot be opened: " + error.text();
    return nullptr;
  }
  if (!arv_camera_is_gv_device(camera.get()) ||
      !arv_gv_device_is_controller(ARV_GV_DEVICE(arv_camera_get_device(camera.get())))) {
    why = "is controlled by another program; it is free again when that one has been gone for its heartbeat";
    return nullptr;
  }
  CameraSettings setup(camera.get(), why);
  setup.wish([&](GError** e) { identity.vendor = stringOf(arv_camera_get_vendor_name(camera.get(), e)); });
  setup.wish([&](GError** e) { identity.model = stringOf(arv_camera_get_model_name(camera.get(), e)); });
  setup.wish(
      [&](GError** e) { identity.serial = stringOf(arv_camera_get_device_serial_number(camera.get(), e)); });
  setPicture(camera.get(), config, setup);
  setTrigger(camera.get(), config, setup);
  setTransport(camera.get(), config, identity.address, setup);
  readBack(camera.get(), config, identity, setup);
  return setup.good() ? std::move(camera) : nullptr;
}

}  // namespace fathom::io
