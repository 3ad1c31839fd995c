#include "recon/surface/packing.hpp"

#include <algorithm>
#include <numeric>

namespace fathom::surface {
namespace {

struct Step {
  int x, width, top;  // of the skyline: free from `top` downwards
};

// Places all in `order`; the height that they take.
int packInto(std::vector<Rectangle>& rectangles, const std::vector<std::size_t>& order, int width) {
  std::vector<Step> skyline = {{0, width, 0}};
  int height = 0;
  for (const std::size_t number : order) {
    Rectangle& r = rectangles[number];
    std::size_t best = skyline.size();
    int best_top = 0;
    for (std::size_t i = 0; i < skyline.size() && skyline[i].x + r.width <= width; ++i) {
      int top = 0;
      for (std::size_t k = i; k < skyline.size() && skyline[k].x < skyline[i].x + r.width; ++k)
        top = std::max(top, skyline[k].top);
      if (best == skyline.size() || top < best_top) {
        best = i;
        best_top = top;
      }
    }
    r.x = skyline[best].x;
    r.y = best_top;
    height = std::max(height, r.y + r.height);
    // The steps under it end where it does.
    const int right = r.x + r.width;
    std::size_t after = best;
    while (after < skyline.size() && skyline[after].x + skyline[after].width <= right) ++after;
    if (after < skyline.size() && skyline[after].x < right) {
      skyline[after].width -= right - skyline[after].x;
      skyline[after].x = right;
    }
    skyline.erase(skyline.begin() + static_cast<std::ptrdiff_t>(best),
                  skyline.begin() + static_cast<std::ptrdiff_t>(after));
    skyline.insert(skyline.begin() + static_cast<std::ptrdiff_t>(best), {r.x, r.width, r.y + r.height});
  }
  return height;
}

}  // namespace

PackedSize pack(std::vector<Rectangle>& rectangles) {
  if (rectangles.empty()) return {};
  std::vector<std::size_t> order(rectangles.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const Rectangle &p = rectangles[a], &q = rectangles[b];
    return p.height != q.height ? p.height > q.height : p.width > q.width;
  });
  int widest = 0, all = 0, narrow = 0;
  for (const Rectangle& r : rectangles) {
    widest = std::max(widest, r.width);
    all += r.width;
  }
  // Beside the widest: what is narrower in a column of its own.
  for (const Rectangle& r : rectangles)
    if (r.width < widest) narrow = std::max(narrow, r.width);
  PackedSize best;
  long long best_area = 0;
  for (const int width : {widest, widest + narrow, widest + 2 * narrow, 2 * widest, 3 * widest, 4 * widest}) {
    if (width > std::max(all, widest)) continue;
    const int height = packInto(rectangles, order, width);
    // Of equal areas the one nearer to a square.
    const long long area = 1LL * width * height, longer = std::max(width, height);
    if (best.width == 0 || area < best_area ||
        (area == best_area && longer < std::max(best.width, best.height))) {
      best = {width, height};
      best_area = area;
    }
  }
  (void)packInto(rectangles, order, best.width);
  return best;
}

}  // namespace fathom::surface
