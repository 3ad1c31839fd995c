#include "tests/bench/fusion_peer/open3d_peer.hpp"

#include <omp.h>
#include <open3d/camera/PinholeCameraIntrinsic.h>
#include <open3d/geometry/Image.h>
#include <open3d/geometry/RGBDImage.h>
#include <open3d/geometry/TriangleMesh.h>
#include <open3d/pipelines/integration/ScalableTSDFVolume.h>
#include <time.h>

#include <cstdlib>
#include <cstring>

namespace fathom::fusion {
namespace {

double cpuMs() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

}  // namespace

PeerRun fuseWithOpen3d(const std::vector<DepthImage>& images, double voxel, double truncation) {
  using namespace open3d;
  // It counts the cores itself unless the environment says something; waiting threads would count as CPU
  // time.
  setenv("OMP_NUM_THREADS", "1", 1);
  omp_set_num_threads(1);
  pipelines::integration::ScalableTSDFVolume volume(voxel, truncation,
                                                    pipelines::integration::TSDFVolumeColorType::RGB8);
  PeerRun out;
  for (const DepthImage& image : images) {
    const Camera& c = image.camera;
    geometry::RGBDImage rgbd;
    rgbd.depth_.Prepare(c.width, c.height, 1, sizeof(float));
    std::memcpy(rgbd.depth_.data_.data(), image.depth.data(), image.depth.size() * sizeof(float));
    rgbd.color_.Prepare(c.width, c.height, 3, 1);
    std::memcpy(rgbd.color_.data_.data(), image.rgb.data(), image.rgb.size());
    const camera::PinholeCameraIntrinsic intrinsic(c.width, c.height, c.fx, c.fy, c.cx, c.cy);
    Eigen::Matrix4d T_cam_nav = Eigen::Matrix4d::Identity();
    const SE3 inverse = image.T_nav_cam.inverse();
    T_cam_nav.topLeftCorner<3, 3>() = inverse.rotation().toRotationMatrix();
    T_cam_nav.topRightCorner<3, 1>() = inverse.translation();
    const double begin = cpuMs();
    volume.Integrate(rgbd, intrinsic, T_cam_nav);
    out.integrate_ms += (cpuMs() - begin) / static_cast<double>(images.size());
  }
  const double begin = cpuMs();
  const auto mesh = volume.ExtractTriangleMesh();
  out.extract_ms = cpuMs() - begin;
  for (const auto& v : mesh->vertices_) out.mesh.vertices.push_back(v.cast<float>());
  for (const auto& t : mesh->triangles_)
    out.mesh.triangles.push_back({static_cast<std::uint32_t>(t[0]), static_cast<std::uint32_t>(t[1]),
                                  static_cast<std::uint32_t>(t[2])});
  return out;
}

}  // namespace fathom::fusion
