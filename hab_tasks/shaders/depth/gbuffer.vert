#version 450
// Position in the camera's frame and nothing else: for depth observations on a software renderer,
// where shading a pixel costs more than finding it.

layout(set = 0, binding = 0) uniform CameraBuffer {
  mat4 viewMatrix;
  mat4 projectionMatrix;
  mat4 viewMatrixInverse;
  mat4 projectionMatrixInverse;
  float width;
  float height;
} cameraBuffer;

layout(set = 1, binding = 0) uniform ObjectTransformBuffer {
  mat4 modelMatrix;
} objectTransformBuffer;

layout(set = 1, binding = 1) uniform ObjectDataBuffer {
  uvec4 segmentation;
  float transparency;
  int shadeFlat;
} objectDataBuffer;

// The renderer binds these five attributes, used or not.
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec3 tangent;
layout(location = 4) in vec3 bitangent;

layout(location = 0) out vec3 cameraPosition;
layout(location = 1) out flat uint actor;

void main() {
  vec4 point = cameraBuffer.viewMatrix * (objectTransformBuffer.modelMatrix * vec4(position, 1));
  cameraPosition = point.xyz;
  actor = objectDataBuffer.segmentation[1];
  gl_Position = cameraBuffer.projectionMatrix * point;
}
