#include "firmware_if/devices/camera/camera_discovery.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <netinet/in.h>

#include <algorithm>
#include <chrono>
#include <mutex>

#include "firmware_if/devices/camera/camera_setup.hpp"

namespace fathom::io {
namespace {

std::uint32_t addressOf(const sockaddr* address) {
  return reinterpret_cast<const sockaddr_in*>(address)->sin_addr.s_addr;
}

// Whether an address belongs to a network of the interface.
bool onInterface(const std::string& address, const std::string& interface) {
  in_addr wanted{};
  if (::inet_pton(AF_INET, address.c_str(), &wanted) != 1) return false;
  ifaddrs* list = nullptr;
  if (::getifaddrs(&list) != 0) return false;
  bool found = false;
  for (const ifaddrs* i = list; i != nullptr; i = i->ifa_next) {
    if (i->ifa_addr == nullptr || i->ifa_addr->sa_family != AF_INET || i->ifa_netmask == nullptr) continue;
    if (interface != i->ifa_name) continue;
    const std::uint32_t mask = addressOf(i->ifa_netmask);
    found = found || (addressOf(i->ifa_addr) & mask) == (wanted.s_addr & mask);
  }
  ::freeifaddrs(list);
  return found;
}

}  // namespace

bool isIpAddress(const std::string& text) {
  in_addr address{};
  return ::inet_pton(AF_INET, text.c_str(), &address) == 1;
}

std::vector<FoundCamera> findCameras(const std::string& interface) {
  // The list is Aravis' own, one for the process. A search that began after this call, while another thread's
  // was awaited, serves this one too.
  static std::mutex one_at_a_time;
  static std::chrono::steady_clock::time_point searched;
  const auto called = std::chrono::steady_clock::now();
  const std::lock_guard lock(one_at_a_time);
  ArvInterface* gige = arv_gv_interface_get_instance();
  if (searched < called) {
    searched = std::chrono::steady_clock::now();
    arv_interface_update_device_list(gige);
  }
  std::vector<FoundCamera> found;
  const unsigned count = arv_interface_get_n_devices(gige);
  for (unsigned i = 0; i < count; ++i) {
    FoundCamera camera{.vendor = stringOf(arv_interface_get_device_vendor(gige, i)),
                       .model = stringOf(arv_interface_get_device_model(gige, i)),
                       .serial = stringOf(arv_interface_get_device_serial_nbr(gige, i)),
                       .address = stringOf(arv_interface_get_device_address(gige, i)),
                       .id = stringOf(arv_interface_get_device_id(gige, i))};
    if (interface.empty() || onInterface(camera.address, interface)) found.push_back(std::move(camera));
  }
  std::sort(found.begin(), found.end(),
            [](const FoundCamera& a, const FoundCamera& b) { return a.serial < b.serial; });
  return found;
}

bool isCamera(const FoundCamera& camera, const std::string& wanted) {
  return wanted == camera.serial || wanted == camera.id || wanted == camera.address ||
         wanted == camera.vendor + "-" + camera.serial;
}

}  // namespace fathom::io
