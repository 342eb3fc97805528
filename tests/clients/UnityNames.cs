// The names of Unity's that the driver's component uses, so that a compiler can hold it to them. They do nothing.

using System.Collections;

namespace UnityEngine
{
    public class Object { public string name; public static bool operator ==(Object a, Object b) => ReferenceEquals(a, b); public static bool operator !=(Object a, Object b) => !ReferenceEquals(a, b); public override bool Equals(object other) => ReferenceEquals(this, other); public override int GetHashCode() => 0; }
    public class TextAsset : Object { public byte[] bytes => null; }
    public class Component : Object { public Transform transform => null; public T GetComponent<T>() where T : class => null; public T[] GetComponentsInChildren<T>(bool inactive) => new T[0]; }
    public class MonoBehaviour : Component { }
    public class Transform : Component { public Transform parent => null; public Matrix4x4 localToWorldMatrix => new Matrix4x4(); }
    public struct Matrix4x4 { public float m00, m01, m02, m03, m10, m11, m12, m13, m20, m21, m22, m23; }
    public class Mesh : Object { public int GetBlendShapeIndex(string name) => -1; public float GetBlendShapeFrameWeight(int shape, int frame) => 0; }
    public class Material : Object { }
    public class Texture2D : Object { public static Texture2D whiteTexture => null; }
    public struct Vector4 { public Vector4(float x, float y, float z, float w) { } }
    public class MaterialPropertyBlock { public void SetTexture(string name, Texture2D value) { } public void SetVector(string name, Vector4 value) { } }
    public class Renderer : Component { public Material[] sharedMaterials => null; public void SetPropertyBlock(MaterialPropertyBlock block, int material) { } }
    public class SkinnedMeshRenderer : Renderer { public Mesh sharedMesh => null; public Transform[] bones => null; public float GetBlendShapeWeight(int shape) => 0; public void SetBlendShapeWeight(int shape, float value) { } }
    public static class Debug { public static void LogWarning(object message, Object context) { } }
    public static class Time { public static float deltaTime => 0; }
    public static class Mathf { public static float Floor(float x) => x; public static float Min(float x, float y) => x; public static float Max(float x, float y) => x; }
    public class AnimationClip : Object { public bool isLooping => false; public float length => 0; }
    public struct AnimatorClipInfo { public AnimationClip clip => null; public float weight => 0; }
    public struct AnimatorStateInfo { public float normalizedTime => 0; }
    public class RuntimeAnimatorController : Object { }
    public class Animator : Component { public RuntimeAnimatorController runtimeAnimatorController => null; public AnimatorClipInfo[] GetCurrentAnimatorClipInfo(int layer) => null; public AnimatorStateInfo GetCurrentAnimatorStateInfo(int layer) => new AnimatorStateInfo(); }
    public class AnimationState { public bool enabled => false; public float weight => 0; public float time => 0; public float length => 0; public string name => ""; }
    public class Animation : Component, IEnumerable { public IEnumerator GetEnumerator() => null; }
}
