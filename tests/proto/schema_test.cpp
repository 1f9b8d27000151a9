#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>

#include "caffe_schema.pb.h"
#include "testing.h"

namespace revisit {
namespace {

/// Emulates loading libcaffe: protobuf terminates a program in which two generated files have the
/// same name or define the same message.
TEST(Schema, IsInOneProgramWithThatOfTheOriginalCaffe) {
  google::protobuf::FileDescriptorProto original;
  original.set_name("caffe.proto");
  original.set_package("caffe");
  for (const char* name : {"NetParameter", "LayerParameter", "BlobProto", "SolverParameter"})
    original.add_message_type()->set_name(name);
  // The bytes must outlive the pool, which keeps a pointer to them.
  static const std::string bytes = original.SerializeAsString();
  google::protobuf::DescriptorPool::InternalAddGeneratedFile(bytes.data(),
                                                             static_cast<int>(bytes.size()));
  const auto* pool = google::protobuf::DescriptorPool::generated_pool();
  const auto* theirs = pool->FindMessageTypeByName("caffe.NetParameter");
  ASSERT_NE(theirs, nullptr);
  EXPECT_EQ(theirs->file()->name(), "caffe.proto");
  EXPECT_EQ(theirs->field_count(), 0);
  const auto* ours = caffe::NetParameter::descriptor();
  EXPECT_EQ(ours->full_name(), "revisit.caffe.NetParameter");
  EXPECT_NE(ours->FindFieldByName("layer"), nullptr);
}

}  // namespace
}  // namespace revisit
