// Blends wrinkle maps in Unreal: the text of a Custom node of a material, whose output type is Float4.
//
// Inputs of the node, by these names: UV (a TextureCoordinate); Own, the sample of the material's own normal map, or the
// constant (0, 0, 1); Normal1, Occlusion1, Mask1, Normal2, Occlusion2 and Mask2 (TextureObjectParameter); Weights1 and
// Weights2, each four ScalarParameters joined by MakeFloat4. RGB of the output goes to Normal, alpha to Ambient Occlusion.
//
// Normals here have their green flipped against glTF's, as Unreal has them. Maps are imported as they are: not sRGB, and
// without Flip Green Channel. A set without a mask has one weight, that of red, and a white texture as its mask.
float m1 = dot(Texture2DSample(Mask1, Mask1Sampler, UV), Weights1);
float m2 = dot(Texture2DSample(Mask2, Mask2Sampler, UV), Weights2);
float2 xy1 = Texture2DSample(Normal1, Normal1Sampler, UV).xy * 2.0 - 1.0;
float2 xy2 = Texture2DSample(Normal2, Normal2Sampler, UV).xy * 2.0 - 1.0;
// Compressed normal maps keep x and y alone.
float2 slope = m1 * xy1 / sqrt(max(1.0 - dot(xy1, xy1), 0.01)) + m2 * xy2 / sqrt(max(1.0 - dot(xy2, xy2), 0.01));
float occlusion = 1.0 + m1 * (Texture2DSample(Occlusion1, Occlusion1Sampler, UV).r - 1.0);
occlusion *= 1.0 + m2 * (Texture2DSample(Occlusion2, Occlusion2Sampler, UV).r - 1.0);
slope = Own.xy / max(Own.z, 0.1) + float2(slope.x, -slope.y);
return float4(normalize(float3(slope, 1.0)), occlusion);
