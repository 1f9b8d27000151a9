#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

namespace revisit::pipeline {

/// LiDARs that can be simulated.
enum class LidarModel {
  kHdl64,     ///< Velodyne HDL-64E S2: 64 beams, +2 to -24.8 deg, 0.1728 deg in azimuth, 120 m
  kVlp16,     ///< Velodyne VLP-16: 16 beams, +15 to -15 deg, 0.2 deg in azimuth, 100 m
  kOs1,       ///< Ouster OS1-64: 64 beams, +22.5 to -22.5 deg, 0.176 deg in azimuth, 120 m
  kFront120,  ///< looks ahead: 120 deg, 64 beams, +12.5 to -12.5 deg, 0.4 deg in azimuth, 150 m
  kAvia  ///< Livox Avia: ahead, 70.4 x 77.2 deg, 24000 points of a rosette that never repeats, 190
         ///< m
};
/// What find_sensor() and `--sensor` call it.
const char* name_of(LidarModel model);

/// What lies beside the road. The numbers of each are in scenery.cpp.
enum class Surroundings {
  kTown,      ///< houses, gardens, fences and parked cars close to the street
  kSuburb,    ///< houses a few metres back, gardens with many plants, cars along the kerb
  kVillage,   ///< houses far back in gardens with hedges and trees
  kCountry,   ///< fields, hedgerows, woods and few farms
  kMotorway,  ///< a wide carriageway, guard rails, banks, noise screens, woods, lorries
  kCarPark,   ///< asphalt with rows of parked cars and lamps; buildings at the rim
  kOldTown,   ///< high fronts without gaps at both sides of a narrow lane
  kRows       ///< the same house every 16 m: places that look alike
};
/// What `--surroundings` calls them.
const char* name_of(Surroundings surroundings);

/// Generated routes, by how they come back to places seen before.
enum class RouteKind {
  kLoop,      ///< round a block and on: revisits in the same direction
  kOpposite,  ///< down a street, round a block, back up the street: the opposite direction
  kBoth       ///< the same with two rounds of the block: both directions
};

/// The camera beside the LiDAR: KITTI's left gray one.
struct SimulatedCamera {
  double scale = 1;  ///< size of the pictures: 1 is 1241 x 376, 0.1 to 1
  /// The sun wanders, clouds pass and the exposure errs in the course of the drive, so that passes
  /// of one place differ. Otherwise the light stays as it is at the beginning.
  bool changing_light = true;
};

/// The sensor's height above the road, as on KITTI's car [m].
constexpr double kSensorHeight = 1.73;

/// How the LiDAR is mounted on the car. The camera rises with it, but keeps level.
struct SensorMount {
  double height = kSensorHeight;  ///< above the road, 0.5 to 5 [m]
  double pitch = 0;               ///< about its y axis (left), > 0: it looks down ahead [deg]
  double roll = 0;  ///< about its x axis (forward), applied first, > 0: it leans to the right [deg]
};

/// What to simulate. Equal settings give equal bytes, for any number of threads.
struct SimulationConfig {
  std::filesystem::path output;  ///< root of the data set in KITTI odometry layout
  std::string sequence = "00";   ///< name of the sequence: `sequences/<sequence>`

  Surroundings surroundings = Surroundings::kTown;
  double traffic = 1;  ///< of the moving vehicles that usually drive there, 0 to 10

  RouteKind route = RouteKind::kLoop;  ///< used when `poses` is not given
  double length = 1200;                ///< of the generated route, 300 to 30000 [m]

  /// A KITTI poses file to drive along instead. The town is laid out along the path seen from
  /// above: x, z and the heading of each pose are used; its height, roll and pitch are not, because
  /// ground-truth height drifts by metres between visits of one place. The sensor always stands
  /// `mount.height` above a smooth ground. The file is copied as it is.
  std::optional<std::filesystem::path> poses;
  /// calib.txt whose `Tr` (T_cam_velo) belongs to `poses`; it is copied, but for `Tr` when
  /// `mount` tilts the LiDAR. Absent: a typical one.
  std::optional<std::filesystem::path> calibration;

  int first_frame = 0;            ///< simulate frames first_frame to last_frame ...
  std::optional<int> last_frame;  ///< ... (inclusive; absent: to the end) ...
  int every = 1;                  ///< ... whose number less first_frame is a multiple of this

  LidarModel sensor = LidarModel::kHdl64;
  SensorMount mount;  ///< of the LiDAR
  /// Each column is cast from where the vehicle is then: from the pose of the frame at the azimuth
  /// 0 to nearly that of the next. Scans are .pcd files, which have the times of points.
  bool rolling_shutter = false;
  double range_noise = 0.02;              ///< standard deviation of a range [m]
  double dropout = 0.01;                  ///< share of returns lost at random, [0, 1)
  std::optional<SimulatedCamera> camera;  ///< absent: scans only
  uint64_t seed = 1;                      ///< town, route, traffic and noise
  int threads = 0;                        ///< 0: all

  bool overwrite = false;  ///< replace scans made with other settings
};

struct SimulationSummary {
  int64_t scans = 0;         ///< asked for and complete
  int64_t kept = 0;          ///< of these, found complete from an earlier run
  double mean_points = 0;    ///< per scan
  double path_metres = 0;    ///< length of the whole drive
  double build_seconds = 0;  ///< for the town
  double scan_seconds = 0;   ///< for casting and writing the new scans
  int64_t triangles = 0;     ///< of the town
};

/// Writes a data set in KITTI odometry layout of a drive through a synthetic world:
///
///     output/sequences/NN/velodyne/000000.bin ...   frames asked for, named by frame number; .pcd
///                                                   with `rolling_shutter`
///     output/sequences/NN/image_0/000000.png ...    with a camera: what it sees at that moment
///     output/sequences/NN/calib.txt, times.txt      times: 0.1 s a frame
///     output/sequences/NN/simulation.txt            the settings, written first
///     output/poses/NN.txt                           T_world_cam, line i = frame i, all frames
///
/// T_world_velo = T_world_cam * Tr, with the Tr of calib.txt. A tilt of the LiDAR is in this Tr,
/// not in the poses: Tr = (Tr of the level LiDAR) * R_y(pitch) * R_x(roll). With generated routes
/// the poses are exact; with `poses` they are the given ones (see there). A scan depends on the
/// settings and its frame number only, not on the frames asked for. Scans are instantaneous (as
/// KITTI's are, being corrected for the motion of the vehicle) without `rolling_shutter`.
///
/// A scan that is there already, made with the same settings, is kept: an interrupted run
/// continues.
///
/// `progress(done, total)` is called with the scans kept, then after every new one; `stop` is asked
/// after every new scan. Throws UsageError for invalid settings, or when the folder holds anything
/// but what this run would write; InputError for a bad poses or calibration file; Interrupted when
/// `stop` said so; Error when a file cannot be written.
SimulationSummary simulate(const SimulationConfig& config,
                           const std::function<void(int64_t done, int64_t total)>& progress = {},
                           const std::function<bool()>& stop = {});

/// What is scanned at places, as in the paper's HKUST data.
enum class PlaceScans {
  kRotation,  ///< 11 scans a place, 77 in all: the tripod is turned by about 40 degrees each time
  kObjects    ///< 13 or 14 a place, 94 in all: the tripod stands, people and cars pass
};

/// Places of a synthetic town, scanned by a VLP-16 on a tripod. Equal settings give equal bytes,
/// for any number of threads; with an equal seed both kinds of scans are of the same places.
struct PlaceSimulationConfig {
  std::filesystem::path output;
  PlaceScans scans = PlaceScans::kRotation;
  double range_noise = 0.02;  ///< standard deviation of a range [m]
  double dropout = 0.01;      ///< share of returns lost at random, [0, 1)
  uint64_t seed = 1;
  int threads = 0;         ///< 0: all
  bool overwrite = false;  ///< replace scans made with other settings
};

/// Writes a folder per place, as open_dataset() reads it:
///
///     output/place_1/0000.bin ... place_7/0012.bin   scans of a place are within 1 m of each other
///     output/scans.csv                               where each scan was taken, and what passed
///     output/simulation.txt                          the settings, written first
///
/// Scans there already are kept, errors are those of simulate().
SimulationSummary simulate_places(
    const PlaceSimulationConfig& config,
    const std::function<void(int64_t done, int64_t total)>& progress = {},
    const std::function<bool()>& stop = {});

}  // namespace revisit::pipeline
