#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

namespace revisit {

constexpr double kSensorHeight = 1.73;  ///< [m] above the road, as on KITTI's car

/// Equal settings give equal bytes for any number of threads.
struct SimulationConfig {
  std::filesystem::path output;  ///< root of the data set in KITTI odometry layout
  std::string sequence = "00";   ///< `sequences/<sequence>`

  /// "town": houses, gardens, fences and parked cars close to the street.
  /// "suburb": houses a few meters back, gardens with many plants, cars along the kerb.
  /// "village": houses far back in gardens with hedges and trees.
  /// "country": fields, hedgerows, woods and few farms.
  /// "motorway": a wide carriageway, guard rails, banks, noise screens, woods, lorries.
  /// "car-park": asphalt with rows of parked cars and lamps; buildings around it.
  /// "old-town": high facades without gaps on both sides of a narrow lane.
  /// "rows": identical houses every 16 m: perceptual aliasing.
  /// Off the street, with a robot's drive: "office": a door every 4 m; "office-irregular"; also
  /// "office-changed": 30 % of doors and furniture differ in the second round; "office-carried": by
  /// a swaying person. "floors": two equal storeys and a ramp. "garage": 30 % of the bays differ in
  /// the second round. "stairwell", "mine", "greenhouse", "forest", "container-yard". They refuse
  /// `poses` and `camera`, and values of `traffic`, `route` and `length` that are not the default.
  std::string surroundings = "town";
  double traffic = 1;  ///< factor on the usual number of moving vehicles, 0 to 10

  /// Used if `poses` is absent. "loop": around a block and on, with revisits in the same direction.
  /// "opposite": down a street, around a block, back up the street. "both": as opposite with two
  /// rounds of the block, for revisits in both directions.
  std::string route = "loop";
  double length = 1200;  ///< generated route, 300 to 30000 [m]

  /// KITTI poses file that defines the drive; copied unchanged. The town is laid out along the
  /// top-down path: x, z and the heading of each pose. Height, roll and pitch are not used, because
  /// the height drifts by meters between visits of one place. The sensor always stands
  /// `sensor_height` above a smooth ground.
  std::optional<std::filesystem::path> poses;
  /// calib.txt whose `Tr` (T_cam_velo) belongs to `poses`. It is copied, except that `Tr` includes
  /// the tilt of the sensor. Absent: a typical one.
  std::optional<std::filesystem::path> calibration;

  int first_frame = 0;            ///< of the drive, the first that is simulated
  std::optional<int> last_frame;  ///< inclusive; absent: the last of the drive
  int every = 1;                  ///< frames first_frame + i * every are simulated

  /// "hdl64": Velodyne HDL-64E S2: 64 beams, +2 to -24.8 deg, 0.1728 deg in azimuth, 120 m.
  /// "vlp16": Velodyne VLP-16: 16 beams, +15 to -15 deg, 0.2 deg in azimuth, 100 m.
  /// "ouster-os1-64": 64 beams, +22.5 to -22.5 deg, 0.176 deg in azimuth, 120 m.
  /// "front120": forward, 120 deg, 64 beams, +12.5 to -12.5 deg, 0.4 deg in azimuth, 150 m.
  /// "hdl32": 32 beams, +10.67 to -30.67 deg, 0.166 deg in azimuth, 100 m.
  /// "ouster-os0-32": 32 beams, +45 to -45 deg, 0.35 deg in azimuth, 50 m.
  /// "pandar-xt32": 32 beams, +15 to -16 deg, 0.18 deg in azimuth, 120 m.
  /// "livox-mid360": 360 deg, +52 to -7 deg, 20000 points on four nodding lines, none repeated, 70
  /// m. "livox-avia": forward, 70.4 x 77.2 deg, 24000 points, non-repetitive rosette, 190 m.
  std::string sensor = "hdl64";
  /// Above the road or floor, 0.5 to 5 [m]. Absent: kSensorHeight, 0.7 of a robot, 1 if carried.
  std::optional<double> sensor_height;
  double sensor_pitch = 0;  ///< about its y axis (left), > 0: it looks down ahead [deg]
  double sensor_roll = 0;   ///< about its x axis (forward), applied first, > 0: leans right [deg]
  /// Each column is cast from the vehicle's pose at that time: from the pose of the frame at
  /// azimuth 0 to nearly the pose of the next frame. Scans are .pcd files with the times of points.
  bool rolling_shutter = false;
  double range_noise = 0.02;  ///< standard deviation of a range [m]
  double dropout = 0.01;      ///< fraction of returns lost at random, [0, 1)
  /// Images of KITTI's left gray camera, beside the LiDAR: as high, but level.
  bool camera = false;
  double image_scale = 1;  ///< 1 is 1241 x 376, 0.1 to 1
  /// True: sun, clouds and exposure errors change during the drive, so that passes of one place
  /// differ. False: the light stays as at the beginning.
  bool changing_light = true;
  uint64_t seed = 1;  ///< seed of town, route, traffic and noise
  int threads = 0;    ///< 0: all

  bool overwrite = false;  ///< replace scans of other settings
};

/// What simulate() wrote.
struct SimulationSummary {
  int64_t scans = 0;         ///< requested and complete
  int64_t kept = 0;          ///< complete from an earlier run
  double mean_points = 0;    ///< per scan
  double path_meters = 0;    ///< length of the drive [m]
  double build_seconds = 0;  ///< to build the world
  double scan_seconds = 0;   ///< to cast and write the new scans
  int64_t triangles = 0;     ///< of the world
};

/// Writes a data set in KITTI odometry layout of a drive through a synthetic world:
///
///     output/sequences/NN/velodyne/000000.bin ...   requested frames, named by frame number; .pcd
///                                                   with `rolling_shutter`
///     output/sequences/NN/image_0/000000.png ...    with a camera: the image at the frame's time
///     output/sequences/NN/calib.txt, times.txt      times: 0.1 s per frame
///     output/sequences/NN/simulation.txt            the settings, written first
///     output/poses/NN.txt                           T_world_cam, line i = frame i, all frames
///
/// T_world_velo = T_world_cam * Tr, with the Tr of calib.txt. A tilt of the LiDAR is in this Tr,
/// not in the poses: Tr = (Tr of the level LiDAR) * R_y(pitch) * R_x(roll). Poses of generated
/// routes are exact; with `poses` they are the given ones (see there). A scan depends only on the
/// settings and its frame number, not on which frames are requested. Without `rolling_shutter`
/// scans are instantaneous, like KITTI's motion-compensated scans.
///
/// Existing scans of the same settings are kept, so that an interrupted run resumes.
///
/// `progress(done, total)` is called with the scans kept, then after every new scan; `stop` is
/// called after every new scan. Throws UsageError for invalid settings, or if the folder holds
/// files that this run would not write; InputError for an invalid poses or calibration file;
/// Interrupted if `stop` returned true; Error if a file cannot be written.
SimulationSummary simulate(const SimulationConfig& config,
                           const std::function<void(int64_t done, int64_t total)>& progress = {},
                           const std::function<bool()>& stop = {});

/// Simulates scans of a VLP-16 on a tripod at places of a synthetic town, as in the paper's HKUST
/// data. Without `objects`: 77 scans, 11 per place, the tripod is rotated by about 40 degrees each
/// time. With them: 94 scans, 13 or 14 per place, the tripod stands, people and cars pass. Both
/// have the same places if the seed is equal. Uses output, range_noise, dropout, seed, threads and
/// overwrite of the settings. Writes a folder per place, in the layout of open_dataset():
///
///     output/place_1/0000.bin ... place_7/0012.bin   scans of a place are within 1 m of each other
///     output/scans.csv                               pose of each scan, and passing objects
///     output/simulation.txt                          the settings, written first
///
/// Existing scans are kept. Throws what simulate() throws.
SimulationSummary simulate_places(
    const SimulationConfig& config, bool objects,
    const std::function<void(int64_t done, int64_t total)>& progress = {},
    const std::function<bool()>& stop = {});

}  // namespace revisit
