#include "daemon/multicast_route.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

namespace submapd {
namespace {

constexpr const char* kScheme = "udpm://";
constexpr const char* kDefaultGroup = "239.255.76.67";  // LCM's, for a URL without one

}  // namespace

bool has_multicast_route(const std::string& url) {
  const std::string scheme = kScheme;
  if (!url.starts_with(scheme)) return true;
  const std::string group = url.substr(scheme.size(), url.find_first_of(":?", scheme.size()) - scheme.size());
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(7667);  // any: nothing is sent
  if (::inet_pton(AF_INET, group.empty() ? kDefaultGroup : group.c_str(), &address.sin_addr) != 1) return true;
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return false;
  const bool reachable = ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  ::close(fd);
  return reachable;
}

}  // namespace submapd
