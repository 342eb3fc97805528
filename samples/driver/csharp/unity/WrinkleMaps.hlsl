// Blends wrinkle maps in Unity's URP and HDRP: the file of a Custom Function node of Shader Graph, whose name is Wrinkle.
//
// Inputs of the node: UV (Vector2) and Own (Vector3), the material's own normal map in tangent space; outputs: Normal
// (Vector3), which goes to the master's Normal (Tangent Space), and Occlusion (Float). The component WrinkleDriver sets
// what is declared here, by a property block: two sets of maps as `wrinkle maps` writes them, each with one mask. A set
// without a mask has one weight, that of red.

#ifndef WRINKLE_MAPS
#define WRINKLE_MAPS

TEXTURE2D(_WrinkleNormal1); SAMPLER(sampler_WrinkleNormal1);
TEXTURE2D(_WrinkleNormal2);
TEXTURE2D(_WrinkleOcclusion1);
TEXTURE2D(_WrinkleOcclusion2);
TEXTURE2D(_WrinkleMask1);
TEXTURE2D(_WrinkleMask2);
float4 _WrinkleWeights1;
float4 _WrinkleWeights2;

// The slopes of a normal map. Textures of the type Normal map keep x and y alone, and some of them x in alpha.
float2 WrinkleSlope(float4 stored)
{
    float2 xy = float2(stored.r * stored.a, stored.g) * 2.0 - 1.0;
    return xy / sqrt(max(1.0 - dot(xy, xy), 0.01));
}

void Wrinkle_float(float2 UV, float3 Own, out float3 Normal, out float Occlusion)
{
    float m1 = dot(SAMPLE_TEXTURE2D(_WrinkleMask1, sampler_WrinkleNormal1, UV), _WrinkleWeights1);
    float m2 = dot(SAMPLE_TEXTURE2D(_WrinkleMask2, sampler_WrinkleNormal1, UV), _WrinkleWeights2);
    float2 slope = Own.xy / max(Own.z, 0.1);
    slope += m1 * WrinkleSlope(SAMPLE_TEXTURE2D(_WrinkleNormal1, sampler_WrinkleNormal1, UV));
    slope += m2 * WrinkleSlope(SAMPLE_TEXTURE2D(_WrinkleNormal2, sampler_WrinkleNormal1, UV));
    Occlusion = 1.0 + m1 * (SAMPLE_TEXTURE2D(_WrinkleOcclusion1, sampler_WrinkleNormal1, UV).r - 1.0);
    Occlusion *= 1.0 + m2 * (SAMPLE_TEXTURE2D(_WrinkleOcclusion2, sampler_WrinkleNormal1, UV).r - 1.0);
    Normal = normalize(float3(slope, 1.0));
}

void Wrinkle_half(half2 UV, half3 Own, out half3 Normal, out half Occlusion)
{
    float3 normal;
    float occlusion;
    Wrinkle_float(UV, Own, normal, occlusion);
    Normal = (half3)normal;
    Occlusion = (half)occlusion;
}

#endif
