#include "recon/surface/block_blender.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fathom::surface {
namespace {

std::size_t sizeOf(int n) {
  return static_cast<std::size_t>(n);
}

}  // namespace

void BlockBlender::gatherNodes(const ChartLattice::Grid& grid, int i0, int j0) {
  columns_ = std::min(kCells + 1, grid.columns - i0);
  rows_ = std::min(kCells + 1, grid.rows - j0);
  count_ = columns_ * rows_;
  const ChartLattice& lattice = *tile_.lattice;
  const std::vector<float>* from[6] = {&lattice.x,  &lattice.y,  &lattice.z,
                                       &lattice.nx, &lattice.ny, &lattice.nz};
  known_.resize(sizeOf(count_));
  for (std::size_t k = 0; k < 6; ++k) points_[k].resize(sizeOf(count_));
  for (int j = 0; j < rows_; ++j) {
    const std::size_t first = grid.node(i0, j0 + j), to = sizeOf(j * columns_);
    for (std::size_t k = 0; k < 6; ++k)
      std::copy_n(from[k]->begin() + static_cast<std::ptrdiff_t>(first), columns_,
                  points_[k].begin() + static_cast<std::ptrdiff_t>(to));
    std::copy_n(lattice.known.begin() + static_cast<std::ptrdiff_t>(first), columns_,
                known_.begin() + static_cast<std::ptrdiff_t>(to));
  }
  float low[3], high[3];
  bool first = true;
  for (std::size_t n = 0; n < known_.size(); ++n) {
    if (known_[n] == 0) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = first ? points_[k][n] : std::min(low[k], points_[k][n]);
      high[k] = first ? points_[k][n] : std::max(high[k], points_[k][n]);
    }
    first = false;
  }
  radius_ = 0;
  if (first) return;
  for (std::size_t k = 0; k < 3; ++k) {
    middle_[static_cast<Eigen::Index>(k)] = 0.5F * (low[k] + high[k]);
    radius_ += 0.25F * (high[k] - low[k]) * (high[k] - low[k]);
  }
  radius_ = std::sqrt(radius_);
}

void BlockBlender::look(std::size_t place, int i0, int j0, BlendCounts& counts) {
  looking_.clear();
  const std::size_t n = sizeOf(count_);
  for (auto* values : {&depth_, &centrality_, &freedom_}) values->resize(n);
  factor_.resize(sizeOf(columns_));
  meeting_.clear();
  float nearest = std::numeric_limits<float>::max();  // of these cameras, to the block's middle
  for (std::uint32_t view = 0; view < tile_.views->size(); ++view) {
    const ViewProjection& projection = (*tile_.views)[view].projection;
    if (!projection.mayMeet(middle_, radius_)) continue;
    meeting_.push_back(view);
    nearest = std::min(nearest, std::max(projection.depthOf(middle_), ViewProjection::kNear));
  }
  const NodePoints nodes{count_,
                         points_[0].data(),
                         points_[1].data(),
                         points_[2].data(),
                         points_[3].data(),
                         points_[4].data(),
                         points_[5].data()};
  for (const std::uint32_t view : meeting_) {
    const ActiveView& active = (*tile_.views)[view];
    const std::size_t row = looking_.size() * n;
    for (auto* values : {&u_, &v_, &low_, &middle_band_, &high_})
      if (values->size() < row + n) values->resize(row + n);
    kernels_.projectNodes(active.projection, nodes, active.fade,
                          {&u_[row], &v_[row], depth_.data(), centrality_.data(), freedom_.data()});
    bool any = false;
    for (std::size_t i = 0; i < n; ++i) {
      if (known_[i] == 0) freedom_[i] = 0;
      if (freedom_[i] == 0) continue;
      const float free = active.depth.visibility(u_[row + i], v_[row + i], depth_[i], tile_.tolerance);
      counts.occluded += free == 0;
      freedom_[i] *= free * active.bands->openness(u_[row + i], v_[row + i], active.fade);
      centrality_[i] += std::max(0.0F, 1 - nearest / depth_[i]);
      any |= freedom_[i] > 0;
    }
    if (!any) continue;
    if (tile_.vote != nullptr && tile_.vote->any()) {
      for (int j = 0; j < rows_; ++j) {
        tile_.vote->factors(view, place, j0 + j, i0, i0 + columns_, factor_.data());
        for (int i = 0; i < columns_; ++i) freedom_[sizeOf(j * columns_ + i)] *= factor_[sizeOf(i)];
      }
    }
    if (config_.mode == BlendMode::kAverage) {
      for (std::size_t i = 0; i < n; ++i) high_[row + i] = freedom_[i] > 0 ? 1.0F : 0.0F;
    } else {
      kernels_.weigh(centrality_.data(), freedom_.data(), count_, static_cast<float>(config_.sharpness[2]),
                     &high_[row]);
    }
    kernels_.weigh(centrality_.data(), freedom_.data(), count_, static_cast<float>(config_.sharpness[0]),
                   &low_[row]);
    kernels_.weigh(centrality_.data(), freedom_.data(), count_, static_cast<float>(config_.sharpness[1]),
                   &middle_band_[row]);
    looking_.push_back(view);
  }
}

void BlockBlender::weighViews() {
  const std::size_t n = sizeOf(count_);
  const auto views = static_cast<int>(looking_.size());
  sums_.resize(2 * n);
  seen_.assign(n, 0);
  for (std::size_t view = 0; view < looking_.size(); ++view)
    for (std::size_t i = 0; i < n; ++i) seen_[i] |= low_[view * n + i] > 0 ? 1 : 0;
  for (auto* weights : {&low_, &middle_band_, &high_})
    kernels_.normalise(weights->data(), views, count_, static_cast<std::ptrdiff_t>(n), sums_.data());
}

void BlockBlender::takeBands() {
  const std::size_t n = sizeOf(count_);
  colour_.assign(4 * n, 0.0F);
  base_.assign(4 * n, 0.0F);
  for (std::size_t view = 0; view < looking_.size(); ++view) {
    const BandImage& bands = *(*tile_.views)[looking_[view]].bands;
    const std::size_t row = view * n;
    kernels_.gatherBands(bands.fine, bands.coarse, &u_[row], &v_[row], &low_[row], &middle_band_[row],
                         &high_[row], count_, colour_.data(), base_.data());
  }
  if (config_.mode == BlendMode::kBands)
    for (std::size_t i = 0; i < base_.size(); ++i) base_[i] = colour_[i] - base_[i];
  else
    std::fill(base_.begin(), base_.end(), 0.0F);
}

void BlockBlender::writeCells(const Chart& chart, const ChartLattice::Grid& grid, int i0, int j0,
                              BlendCounts& counts) {
  const std::size_t n = sizeOf(count_);
  RgbImage& atlas = *tile_.atlas;
  std::vector<CellView>& views = cell_views_;
  for (int j = 0; j + 1 < rows_; ++j) {
    for (int i = 0; i + 1 < columns_; ++i) {
      const std::uint8_t covered = tile_.lattice->covered[grid.cell(i0 + i, j0 + j)];
      if (covered == 0) continue;
      const std::size_t first = sizeOf(j * columns_ + i);
      const std::array<std::size_t, 4> corner{first, first + 1, first + sizeOf(columns_),
                                              first + sizeOf(columns_) + 1};
      const int sighted = seen_[corner[0]] + seen_[corner[1]] + seen_[corner[2]] + seen_[corner[3]];
      if (sighted == 0) {
        counts.unseen += covered;
        continue;
      }
      std::array<float, 16> base{};
      for (std::size_t k = 0; k < 4; ++k)
        if (seen_[corner[k]] != 0) std::copy_n(&base_[4 * corner[k]], 4, &base[4 * k]);
      if (sighted < 4) {
        std::array<float, 4> mean{};
        for (std::size_t k = 0; k < 4; ++k)
          for (std::size_t c = 0; c < 4 && seen_[corner[k]] != 0; ++c)
            mean[c] += colour_[4 * corner[k] + c] / static_cast<float>(sighted);
        for (std::size_t k = 0; k < 4; ++k)
          if (seen_[corner[k]] == 0) std::copy_n(mean.begin(), 4, &base[4 * k]);
      }
      views.clear();
      for (std::size_t view = 0; view < looking_.size(); ++view) {
        const std::size_t row = view * n;
        CellView cell;
        float sum = 0;
        for (std::size_t k = 0; k < 4; ++k) sum += cell.weight[k] = high_[row + corner[k]];
        if (sum == 0) continue;
        for (std::size_t k = 0; k < 4; ++k) cell.u[k] = u_[row + corner[k]], cell.v[k] = v_[row + corner[k]];
        const RgbImage& image = (*tile_.views)[looking_[view]].bands->image;
        cell.place = (*tile_.views)[looking_[view]].place;
        cell.pixels = image.rgb.data();
        cell.stride = static_cast<std::ptrdiff_t>(3) * image.width;
        // A pixel is read as four bytes, and with its neighbours right and below.
        cell.limit_u = static_cast<float>(image.width) - 2.01F;
        cell.limit_v = static_cast<float>(image.height) - 1.01F;
        views.push_back(cell);
      }
      const int x = kTexelStep * (i0 + i), y = kTexelStep * (j0 + j);
      const CellTexels texels{atlas.at(chart.x + x, chart.y + y),
                              static_cast<std::ptrdiff_t>(3) * atlas.width,
                              std::min(kTexelStep, chart.width - x), std::min(kTexelStep, chart.height - y)};
      counts.samples += views.size() * covered;
      if (config_.mode == BlendMode::kUnblended)
        writeBest(views, texels,
                  static_cast<std::size_t>(chart.y + y) * sizeOf(atlas.width) + sizeOf(chart.x + x));
      else
        kernels_.blendCell(views.data(), static_cast<int>(views.size()), base.data(), texels);
    }
  }
}

void BlockBlender::writeBest(const std::vector<CellView>& views, const CellTexels& texels,
                             std::size_t first_texel) {
  std::array<std::uint32_t, kTexelStep * kTexelStep> chosen{};
  kernels_.bestCell(views.data(), static_cast<int>(views.size()), texels, chosen.data());
  for (int y = 0; y < texels.rows; ++y)
    for (int x = 0; x < texels.columns; ++x)
      (*tile_.chosen)[first_texel + sizeOf(y) * sizeOf(tile_.atlas->width) + sizeOf(x)] =
          views[chosen[sizeOf(kTexelStep * y + x)]].place;
}

void BlockBlender::blend(const Chart& chart, std::size_t place, int i0, int j0, ColourGrid& seen,
                         BlendCounts& counts) {
  const ChartLattice::Grid& grid = tile_.lattice->grids[place];
  gatherNodes(grid, i0, j0);
  look(place, i0, j0, counts);
  weighViews();
  takeBands();
  writeCells(chart, grid, i0, j0, counts);
  for (int j = 0; j < rows_; ++j) {
    for (int i = 0; i < columns_; ++i) {
      const std::size_t from = sizeOf(j * columns_ + i), to = sizeOf((j0 + j) * grid.columns + i0 + i);
      if (seen_[from] == 0) continue;
      seen.known[to] = 1;
      std::copy_n(&colour_[4 * from], 4, &seen.values[4 * to]);
    }
  }
}

}  // namespace fathom::surface
